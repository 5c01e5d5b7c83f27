"""Coordination of a team: each servicer tells the others what it plans, and keeps the latest that it received."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.batching import batching_mode
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import apply
from rpojax.flight.cooperation import message, received_messages
from rpojax.flight.cooperation.sharing import SharingMemory
from rpojax.flight.cooperation.team_records import for_receivers
from rpojax.flight.cooperation.team_settings import LinkSettings
from rpojax.flight.team_guidance import direction_map, intent, team_knowledge
from rpojax.flight.team_guidance.intent import Intent
from rpojax.flight.team_guidance.team_knowledge import KnownPeers
from rpojax.flight.team_guidance.team_situation import TeamTuning

Scalar = Float[Array, ""]


@pytree
class Coordination:
    """Memory of one servicer, or of all along the last axis.

    Attributes:
        line: its messages of the last ticks, newest first along the first axis
        latest: the latest message of each peer, (peers, ...)
        last_seen: (directions,) when each side of the target was last seen by anybody [s], None if no one asks
    """

    line: Intent
    latest: Intent
    last_seen: Array | None = None


@pytree
class Announcements:
    """What servicers bring to the coordination, (..., N).

    Attributes:
        plans: of each
        slots: (rows, N) phases of the relative orbits by the plan, in each phase of the mission [rad]
        place_H: (3, N) of each in the target's Hill frame by its estimate [m]
        R_HN: (3, 3, N) that frame
        sun_H: (3, N) direction to the Sun
    """

    plans: Intent
    slots: Array
    place_H: Array
    R_HN: Array
    sun_H: Array


def initial(settings: LinkSettings, time: Scalar, maps_directions: bool) -> Coordination:
    """Memory (..., N) of all servicers at hand-over, at `time` [s]; they may map the sides that were seen."""
    first = intent.before_the_first(time)
    latest = jax.tree.map(lambda leaf: jnp.stack([leaf] * (settings.servicers - 1)), first)
    seen = direction_map.unseen(time) if maps_directions else None
    memory = Coordination(line=message.delay_line(first, settings.delay_ticks), latest=latest, last_seen=seen)
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * settings.servicers, axis=-1), memory)


def share(
    settings: LinkSettings,
    tuning: TeamTuning,
    memory: Coordination,
    sharing: SharingMemory,
    announced: Announcements,
    arrived: Bool[Array, "peers N"],
) -> tuple[KnownPeers, Coordination]:
    """What each servicer knows of its peers after the messages of a tick, and the memory; all (..., N).

    Args:
        settings: of the messages
        tuning: of the guidance of the team
        memory: of the tick before
        sharing: after the messages of the tick
        announced: by all servicers
        arrived: (peers, N) bool, whether each receives what is due now of each of its peers
    """
    line = batching_mode.transform()(message.push, in_axes=-1, out_axes=-1)(memory.line, announced.plans)
    numbers = jnp.arange(settings.servicers, dtype=jnp.int32)
    of_peers = (*for_receivers((message.oldest(line), numbers), settings.peers), arrived)

    def receive(
        before: Coordination,
        own: Announcements,
        number: Array,
        of_peers: tuple[Intent, Array, Bool[Array, " peers"]],
        sharing: SharingMemory,
    ) -> tuple[KnownPeers, Coordination]:
        plans, peer_numbers, arrived = of_peers
        is_new = arrived & (plans.time >= before.latest.time)
        latest = received_messages.select_peers(is_new, plans, before.latest)
        state_N, covariance_N = team_knowledge.motion(sharing)
        last_seen = before.last_seen
        if last_seen is not None:
            sees = jnp.concatenate([own.plans.sees[None], is_new & latest.sees])
            seen = direction_map.seen_by_any(tuning, _places(own, state_N), sees, own.sun_H)
            last_seen = jnp.where(seen, own.plans.time, last_seen)
        known = KnownPeers(
            state_N=state_N,
            covariance_N=covariance_N,
            intents=latest,
            numbers=peer_numbers,
            number=number,
            slots=announced.slots,
            last_seen=last_seen,
        )
        return known, replace(before, latest=latest, last_seen=last_seen)

    return batching_mode.transform()(receive, in_axes=-1, out_axes=-1)(
        replace(memory, line=line), announced, numbers, of_peers, sharing
    )


def _places(own: Announcements, state_N: Float[Array, "peers 6"]) -> Float[Array, "3 n"]:
    """Places of this servicer and its peers in H [m]."""
    peers = [own.place_H + apply(own.R_HN, state_N[k, :3]) for k in range(state_N.shape[0])]
    return jnp.stack([own.place_H, *peers], axis=1)
