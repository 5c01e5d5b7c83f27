"""What a servicer knows of the motion and the plans of the others, from their messages."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.core.state_layout import MOTION
from rpojax.flight.cooperation.sharing import SharingMemory
from rpojax.flight.team_guidance.intent import Intent


@pytree
class KnownPeers:
    """The other servicers as one of them knows them, (peers, ...).

    Attributes:
        state_N: (peers, 6) position [m] and velocity [m/s] from this servicer
        covariance_N: (peers, 6, 6)
        intents: latest plans of each that have arrived
        numbers: (peers,) int32, their places in the team
        number: () int32, the own one
        slots: (rows, N) phases of the relative orbits of all by the plan, in each phase of the mission [rad]
        last_seen: (directions,) when each side of the target was last seen by anybody [s], None if no one asks
    """

    state_N: Array
    covariance_N: Array
    intents: Intent
    numbers: Array
    number: Array
    slots: Array
    last_seen: Array | None = None


def motion(memory: SharingMemory) -> tuple[Float[Array, "peers 6"], Float[Array, "peers 6 6"]]:
    """Position [m] and velocity [m/s] of the peers from this servicer in N, with covariance, by its filter."""
    if memory.joint is not None:
        count = memory.joint.peers.shape[0]
        covariances = [memory.joint.covariance.of_body(1 + k, 0) for k in range(count)]
        return memory.joint.peers[:, : MOTION.size], jnp.stack(covariances)
    assert memory.estimates is not None
    baselines = memory.estimates.baselines
    return baselines.mean[:, : MOTION.size], baselines.covariance[:, : MOTION.size, : MOTION.size]
