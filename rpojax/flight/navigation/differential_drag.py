"""Believed acceleration by drag and sunlight, whose difference between target and servicer the filter estimates."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.constants import RADIUS_EARTH, SOLAR_FLUX, SPEED_OF_LIGHT
from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits.exponential_atmosphere import Atmosphere, density_and_flow

Vector = Float[Array, "3"]

DRAG_COEFFICIENT = 2.2
"""Of compact bodies in free molecular flow (Vallado, Fundamentals of Astrodynamics and Applications, section 8.6.2)."""
PRESSURE_COEFFICIENT = 1.3
"""Of a surface that absorbs most sunlight and scatters the rest: between 1, all absorbed, and 2, all reflected."""


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
