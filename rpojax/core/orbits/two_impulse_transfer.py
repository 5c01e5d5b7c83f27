"""Free relative motion between two positions in a given time."""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


def departure_velocity(transition: Float[Array, "6 6"], start: Vector, end: Vector, dt: Scalar) -> Vector:
    """Velocity rho_dot [m/s] at `start` [m] with which the free motion is at `end` [m] after `dt` [s].

    `transition` is the state transition matrix over `dt`, whose motion across the orbit plane is decoupled. Some times
    admit no such motion: for the cross-track part whenever the target has moved by half turns, for the part in the
    plane after whole orbits and between them. Next to these times the velocity is bounded, and the end is missed.
    """
    drift = end - jnp.sum(transition[:3, :3] * start[None, :], axis=1)
    by_velocity = transition[:3, 3:] / dt
    (a, b), (c, d) = by_velocity[0, :2], by_velocity[1, :2]
    in_plane = 1.0 / _away_from_zero(a * d - b * c)
    across = 1.0 / _away_from_zero(by_velocity[2, 2])
    x, y, z = drift / dt
    return jnp.stack([(d * x - b * y) * in_plane, (a * y - c * x) * in_plane, z * across])


def _away_from_zero(x: Scalar) -> Scalar:
    return jnp.where(x < 0.0, jnp.minimum(x, -_LEAST), jnp.maximum(x, _LEAST))


_LEAST: Final = 1e-3
"""Least divisor, relative to the one for motion in a straight line [-]."""
