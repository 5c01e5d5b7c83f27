"""Star tracker: inertial attitude with noise and a fixed misalignment, not available near the Sun."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]


@pytree
class StarTracker:
    """Mounting and errors of the star tracker.

    Attributes:
        noise: (3,) white noise about each body axis, 1 sigma [rad]
        misalignment: (3,) small rotation of its axes [rad]
        boresight: (3,) its direction in B, any length
        sun_exclusion: () least angle between boresight and Sun [rad]
    """

    noise: Array
    misalignment: Array
    boresight: Array
    sun_exclusion: Array


def is_available(star_tracker: StarTracker, q_BN: Float[Array, "4"], r_sun_N: Vector) -> Bool[Array, ""]:
    """True while the Sun is far enough from the boresight."""
    boresight_N = quaternion.rotate(quaternion.conjugate(q_BN), quaternion.normalize(star_tracker.boresight))
    return jnp.sum(boresight_N * quaternion.normalize(r_sun_N), axis=0) < jnp.cos(star_tracker.sun_exclusion)


def measure(star_tracker: StarTracker, q_BN: Float[Array, "4"], normals: Vector) -> Float[Array, "4"]:
    """Measured attitude `q_BN`."""
    error = quaternion.exp(star_tracker.misalignment + star_tracker.noise * normals)
    return quaternion.multiply(error, q_BN)
