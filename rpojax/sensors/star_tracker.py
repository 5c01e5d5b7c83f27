"""Star tracker: inertial attitude with noise and a fixed misalignment, not available near the Sun."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree
from rpojax.value_types import Direction

Vector = Float[Array, "3"]


@pytree
class StarTracker:
    """Mounting and errors of the star tracker."""

    noise: Array = number("white noise about each body axis, 1 sigma", unit="deg", length=3, at_least=0.0)
    misalignment: Array = number("constant small rotation of its axes", unit="deg", length=3)
    boresight: Array = number("boresight, B; any length", form=Direction)
    sun_exclusion: Array = number(
        "not available while the Sun is nearer to the boresight", unit="deg", at_least=0.0, below=180.0
    )


def is_available(star_tracker: StarTracker, q_BN: Float[Array, "4"], r_sun_N: Vector) -> Bool[Array, ""]:
    """True while the Sun is far enough from the boresight."""
    boresight_N = quaternion.rotate(quaternion.conjugate(q_BN), quaternion.normalize(star_tracker.boresight))
    return jnp.sum(boresight_N * quaternion.normalize(r_sun_N), axis=0) < jnp.cos(star_tracker.sun_exclusion)


def measure(star_tracker: StarTracker, q_BN: Float[Array, "4"], normals: Vector) -> Float[Array, "4"]:
    """Measured attitude `q_BN`."""
    error = quaternion.exp(star_tracker.misalignment + star_tracker.noise * normals)
    return quaternion.multiply(error, q_BN)
