"""Coordination of a team: each servicer tells the others what it plans, and keeps the latest that it heard."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.batching import batching_mode
from rpojax.core.pytree import pytree, replace
from rpojax.flight.cooperation import peer_news
from rpojax.flight.cooperation.link_settings import LinkSettings
from rpojax.flight.cooperation.sharing import SharingMemory
from rpojax.flight.cooperation.team_records import for_receivers
from rpojax.flight.team_guidance import intent, known_peers
from rpojax.flight.team_guidance.intent import Intent
from rpojax.flight.team_guidance.known_peers import KnownPeers

Scalar = Float[Array, ""]


@pytree
class Coordination:
    """Memory of one servicer, or of all along the last axis.

    Attributes:
        line: its messages of the last ticks, newest first along the first axis
        latest: the latest message of each peer, (peers, ...)
    """

    line: Intent
    latest: Intent


def initial(settings: LinkSettings, time: Scalar) -> Coordination:
    """Memory (..., N) of all servicers at hand-over, at `time` [s]."""
    first = intent.before_the_first(time)
    latest = jax.tree.map(lambda leaf: jnp.stack([leaf] * (settings.servicers - 1)), first)
    one = Coordination(line=intent.delay_line(first, settings.delay_ticks), latest=latest)
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * settings.servicers, axis=-1), one)


def share(
    settings: LinkSettings, memory: Coordination, sharing: SharingMemory, plans: Intent, received: Bool[Array, "N N"]
) -> tuple[KnownPeers, Coordination]:
    """What each servicer knows of its peers after the messages of a tick, and the memory; all (..., N).

    Args:
        settings: static settings
        memory: of the tick before
        sharing: after the messages of the tick
        plans: of all servicers
        received: (N, N) bool, which receiver gets the message of which sender that is due now
    """
    line = batching_mode.transform()(intent.push, in_axes=-1, out_axes=-1)(memory.line, plans)
    arrived = for_receivers(intent.oldest(line), settings.peers)
    heard = jnp.stack([jnp.stack([received[i, j] for j in row]) for i, row in enumerate(settings.peers)], axis=-1)
    numbers = jnp.asarray(settings.peers, dtype=jnp.int32).T

    def receive(
        latest: Intent, arrived: Intent, heard: Bool[Array, " peers"], sharing: SharingMemory, numbers: Array
    ) -> tuple[Intent, KnownPeers]:
        latest = peer_news.select_peers(heard & (arrived.time >= latest.time), arrived, latest)
        state_N, covariance_N = known_peers.motion(sharing)
        return latest, KnownPeers(state_N=state_N, covariance_N=covariance_N, intents=latest, numbers=numbers)

    latest, known = batching_mode.transform()(receive, in_axes=-1, out_axes=-1)(
        memory.latest, arrived, heard, sharing, numbers
    )
    return known, replace(memory, line=line, latest=latest)
