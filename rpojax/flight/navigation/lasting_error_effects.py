"""Directions in which errors that last act on the relative motion: thrust, its direction, drag and solar pressure."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.core.vectors import cross

Vector = Float[Array, "3"]


@pytree
class LastingEffects:
    """Effect of a unit of each lasting error over a tick.

    Attributes:
        thrust_axes_N: (3, 3) direction of the thrust and two axes across it in N, unit, one a row
        ballistic_N: (3,) acceleration of the target from the servicer if its area over its mass were greater than the
            servicer's by 1 m^2/kg [m/s^2]
    """

    thrust_axes_N: Array
    ballistic_N: Array


def none() -> LastingEffects:
    """Nothing that pushes servicer and target apart, and a thrust along x of N."""
    return LastingEffects(thrust_axes_N=jnp.eye(3), ballistic_N=jnp.zeros(3))


def thrust_axes(q_BN: Float[Array, "4"], thrust_direction_B: Vector) -> Float[Array, "3 3"]:
    """Direction of the thrust and two axes across it in N, one a row, of a body with the attitude `q_BN`."""
    # The axis of B that is farthest from the thrust.
    axis = jnp.argmin(jnp.abs(thrust_direction_B), axis=0)
    first = gradient_safe.normalize(cross(thrust_direction_B, jnp.where(jnp.arange(3) == axis, 1.0, 0.0)))
    second = cross(thrust_direction_B, first)
    q_NB = quaternion.conjugate(q_BN)
    return jnp.stack([quaternion.rotate(q_NB, axis) for axis in (thrust_direction_B, first, second)])
