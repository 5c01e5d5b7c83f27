"""Evidence of boxes at any rate of the camera: the time for which a frame with a box, or without one, speaks."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, ""]

_LONGEST_EVIDENCE_S = 1.0
"""Longest time for which one frame speaks [s]: a single box may be false, however long it takes until the next."""


def evidence_time(interval: Scalar | float) -> Scalar:
    """Time [s] for which a frame speaks that follows the one before it after `interval` [s].

    Frames of the same second show the target in nearly the same attitude and share the evidence of one frame.
    """
    return jnp.minimum(interval, _LONGEST_EVIDENCE_S)


def fade(factor: float, interval: Scalar | float) -> Scalar:
    """Factor on the evidence so far after a frame without a box; `factor` is that of a second without one."""
    return jnp.power(factor, evidence_time(interval))
