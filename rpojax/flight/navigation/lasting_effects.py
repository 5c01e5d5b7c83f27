"""Directions in which errors that last act on the relative motion: thrust, its direction, drag and solar pressure."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.constants import RADIUS_EARTH, SOLAR_FLUX, SPEED_OF_LIGHT
from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits.exponential_atmosphere import Atmosphere, density_and_flow
from rpojax.core.pytree import pytree
from rpojax.core.vectors import cross

Vector = Float[Array, "3"]

DRAG_COEFFICIENT = 2.2
"""Of compact bodies in free molecular flow (Vallado, Fundamentals of Astrodynamics and Applications, section 8.6.2)."""
PRESSURE_COEFFICIENT = 1.3
"""Of a surface that absorbs most sunlight and scatters the rest: between 1, all absorbed, and 2, all reflected."""


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


def ballistic_acceleration(atmosphere: Atmosphere, r_N: Vector, v_N: Vector, sun_N: Vector) -> Vector:
    """Acceleration (3,) [m/s^2] by drag and sunlight of a body with an area over mass of 1 m^2/kg.

    It is at `r_N` [m], moves by `v_N` [m/s], and the Sun is at `sun_N` [m].
    """
    density, flow = density_and_flow(atmosphere, RADIUS_EARTH, r_N, v_N)
    drag = -0.5 * DRAG_COEFFICIENT * density * gradient_safe.norm(flow) * flow
    from_sun = gradient_safe.normalize(r_N - sun_N)
    behind = jnp.sum(r_N * from_sun, axis=0)
    beside = jnp.sum(r_N * r_N, axis=0) - behind * behind
    # A shadow without penumbra, which is a hundredth of it in a low orbit.
    in_shadow = (behind > 0.0) & (beside < RADIUS_EARTH**2)
    return drag + jnp.where(in_shadow, 0.0, PRESSURE_COEFFICIENT * SOLAR_FLUX / SPEED_OF_LIGHT) * from_sun
