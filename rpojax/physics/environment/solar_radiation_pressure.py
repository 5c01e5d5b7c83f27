"""Solar radiation pressure with the Earth's shadow."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.constants import ASTRONOMICAL_UNIT, RADIUS_EARTH, RADIUS_SUN, SPEED_OF_LIGHT
from rpojax.core.declared_numbers import number
from rpojax.core.orbits.eclipse import illumination
from rpojax.core.pytree import pytree
from rpojax.physics.environment.spacecraft_surface import Surface

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class Sunlight:
    """Solar flux and the radii that determine the shadow.

    Attributes:
        shadow_radius: () of the Earth as it casts its shadow [m]
        sun_radius: () [m]
        astronomical_unit: () distance at which the flux is stated [m]
    """

    flux: Array = number("solar flux at one astronomical unit", unit="w_m2", at_least=0.0)
    shadow_radius: Array | float = RADIUS_EARTH
    sun_radius: Array | float = RADIUS_SUN
    astronomical_unit: Array | float = ASTRONOMICAL_UNIT


def sunlit_fraction(sunlight: Sunlight, r_N: Vector, r_sun_N: Vector) -> Scalar:
    """Visible fraction of the Sun's disc [-] at an inertial position [m]: 1 in light, 0 in umbra."""
    return illumination(r_N, r_sun_N, sunlight.shadow_radius, sunlight.sun_radius)


def solar_radiation_pressure(
    sunlight: Sunlight, surface: Surface, r_N: Vector, r_sun_N: Vector, sunlit_fraction: Scalar
) -> Vector:
    """Force of sunlight [N] in N on a surface at an inertial position [m], scaled by the sunlit fraction [-]."""
    from_sun = r_N - r_sun_N
    square = jnp.sum(from_sun * from_sun, axis=0)
    pressure = sunlight.flux / SPEED_OF_LIGHT * sunlight.astronomical_unit**2 / square
    return sunlit_fraction * pressure * surface.pressure_coefficient * surface.area / jnp.sqrt(square) * from_sun
