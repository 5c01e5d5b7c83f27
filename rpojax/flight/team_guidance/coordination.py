"""Coordination of a team: each servicer tells the others what it plans, and keeps the latest that it heard."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.batching import batching_mode
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import apply
from rpojax.flight.cooperation import peer_news
from rpojax.flight.cooperation.link_settings import LinkSettings
from rpojax.flight.cooperation.sharing import SharingMemory
from rpojax.flight.cooperation.team_records import for_receivers
from rpojax.flight.team_guidance import direction_map, intent, known_peers
from rpojax.flight.team_guidance.intent import Intent
from rpojax.flight.team_guidance.known_peers import KnownPeers
from rpojax.flight.team_guidance.team_tuning import TeamTuning

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
class Sight:
    """Where servicers look at the target from, (..., N).

    Attributes:
        place_H: (3, N) of each in the target's Hill frame by its estimate [m]
        R_HN: (3, 3, N) that frame
        sun_H: (3, N) direction to the Sun
    """

    place_H: Array
    R_HN: Array
    sun_H: Array


def initial(settings: LinkSettings, time: Scalar, maps_directions: bool) -> Coordination:
    """Memory (..., N) of all servicers at hand-over, at `time` [s]; they may map the sides that were seen."""
    first = intent.before_the_first(time)
    latest = jax.tree.map(lambda leaf: jnp.stack([leaf] * (settings.servicers - 1)), first)
    seen = direction_map.unseen(time) if maps_directions else None
    one = Coordination(line=intent.delay_line(first, settings.delay_ticks), latest=latest, last_seen=seen)
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * settings.servicers, axis=-1), one)


def share(
    settings: LinkSettings,
    tuning: TeamTuning,
    memory: Coordination,
    sharing: SharingMemory,
    plans: Intent,
    sight: Sight,
    slots: Float[Array, "rows N"],
    received: Bool[Array, "N N"],
) -> tuple[KnownPeers, Coordination]:
    """What each servicer knows of its peers after the messages of a tick, and the memory; all (..., N).

    Args:
        settings: static settings
        tuning: of the guidance of the team
        memory: of the tick before
        sharing: after the messages of the tick
        plans: of all servicers
        sight: of the target from all of them
        slots: (rows, N) phases of the relative orbits by the plan [rad]
        received: (N, N) bool, which receiver gets the message of which sender that is due now
    """
    line = batching_mode.transform()(intent.push, in_axes=-1, out_axes=-1)(memory.line, plans)
    arrived = for_receivers(intent.oldest(line), settings.peers)
    heard = jnp.stack([jnp.stack([received[i, j] for j in row]) for i, row in enumerate(settings.peers)], axis=-1)
    numbers = jnp.asarray(settings.peers, dtype=jnp.int32).T

    def receive(
        before: Coordination,
        own: Intent,
        arrived: Intent,
        heard: Bool[Array, " peers"],
        sharing: SharingMemory,
        sight: Sight,
        numbers: Array,
        number: Array,
    ) -> tuple[KnownPeers, Coordination]:
        heard = heard & (arrived.time >= before.latest.time)
        latest = peer_news.select_peers(heard, arrived, before.latest)
        state_N, covariance_N = known_peers.motion(sharing)
        last_seen = before.last_seen
        if last_seen is not None:
            places_H, sees = _places(sight, state_N), jnp.concatenate([own.sees[None], heard & latest.sees])
            last_seen = direction_map.update(tuning, last_seen, places_H, sees, sight.sun_H, own.time)
        known = KnownPeers(
            state_N=state_N,
            covariance_N=covariance_N,
            intents=latest,
            numbers=numbers,
            number=number,
            slots=slots,
            last_seen=last_seen,
        )
        return known, replace(before, latest=latest, last_seen=last_seen)

    every = jnp.arange(settings.servicers, dtype=jnp.int32)
    return batching_mode.transform()(receive, in_axes=-1, out_axes=-1)(
        replace(memory, line=line), plans, arrived, heard, sharing, sight, numbers, every
    )


def _places(sight: Sight, state_N: Float[Array, "peers 6"]) -> Float[Array, "3 n"]:
    """Places of this servicer and its peers in H [m]."""
    count = state_N.shape[0]
    return jnp.stack(
        [sight.place_H, *(sight.place_H + apply(sight.R_HN, state_N[k, :3]) for k in range(count))], axis=1
    )
