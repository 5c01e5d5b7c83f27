"""Radio links between servicers: which of the messages that are due arrive.

Losses come singly and in bursts, by a two-state Markov chain (Gilbert, "Capacity of a burst-noise channel", 1960;
Elliott, 1963); in outage windows nothing arrives.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class RadioLink:
    """Properties of all links.

    Attributes:
        outage_start: (outages,) of windows without any message [s]
        outage_end: (outages,) [s]
    """

    loss: Array = number("probability that a message is lost outside of bursts", at_least=0.0, at_most=1.0, default=0.0)
    burst_loss: Array = number("the same in a burst", at_least=0.0, at_most=1.0, default=1.0)
    burst_interval: Array = number(
        "mean time from the end of a burst to the next; so long by default that there are none",
        unit="s",
        above=0.0,
        default=1e9,
    )
    burst_duration: Array = number("mean duration of a burst", unit="s", above=0.0, default=10.0)
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
