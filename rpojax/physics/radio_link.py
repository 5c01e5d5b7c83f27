"""Radio links between servicers: which of the messages that are due arrive.

Losses come singly and in bursts, by a two-state Markov chain (Gilbert, "Capacity of a burst-noise channel", 1960;
Elliott, 1963); in outage windows nothing arrives.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class RadioLink:
    """Properties of all links.

    Attributes:
        loss: () probability of losing a message outside of bursts [-]
        burst_loss: () probability of losing a message in a burst [-]
        burst_interval: () mean time from the end of a burst to the next one [s]
        burst_duration: () mean duration of a burst [s]
        outage_start: (outages,) of windows without any message [s]
        outage_end: (outages,) [s]
    """

    loss: Array
    burst_loss: Array
    burst_interval: Array
    burst_duration: Array
    outage_start: Array
    outage_end: Array


def advance_bursts(
    link: RadioLink, in_burst: Bool[Array, "N N"], uniforms: Float[Array, "N N"], dt: float
) -> Bool[Array, "N N"]:
    """Whether each link is in a burst of losses `dt` [s] later."""
    begins, ends = 1.0 - jnp.exp(-dt / link.burst_interval), 1.0 - jnp.exp(-dt / link.burst_duration)
    return jnp.where(in_burst, uniforms >= ends, uniforms < begins)


def arrives(
    link: RadioLink, in_burst: Bool[Array, "N N"], uniforms: Float[Array, "N N"], time: Scalar
) -> Bool[Array, "N N"]:
    """Whether a message arrives at `time` [s] over each link."""
    lost = uniforms < jnp.where(in_burst, link.burst_loss, link.loss)
    out = jnp.any((time >= link.outage_start) & (time < link.outage_end), axis=0)
    return ~lost & ~out
