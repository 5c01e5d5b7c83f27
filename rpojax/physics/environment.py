"""What surrounds the vehicles: the sky, the air, sunlight, and the forces and torques that they exert."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.constants import ASTRONOMICAL_UNIT, MU_EARTH, RADIUS_EARTH, RADIUS_SUN, SPEED_OF_LIGHT
from rpojax.core.frames import apply
from rpojax.core.numerics.safe import norm
from rpojax.core.orbits.eclipse import illumination
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import cross

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class SunMoonPositions:
    """Bodies beyond the Earth, at the present time.

    Attributes:
        sun_N: (3,) position of the Sun [m]
        moon_N: (3,) position of the Moon [m]
    """

    sun_N: Array
    moon_N: Array


@pytree
class Atmosphere:
    """Air whose density falls off exponentially with height, turning with the Earth or not.

    Attributes:
        density: () at the reference altitude [kg/m^3]
        altitude: () of reference, above the equatorial radius [m]
        scale_height: () [m]
        rotation: () of the air about the pole [rad/s]
    """

    density: Array
    altitude: Array
    scale_height: Array
    rotation: Array


@pytree
class Sunlight:
    """Sunlight and what shades it.

    Attributes:
        flux: () at one astronomical unit [W/m^2]
        shadow_radius: () of the Earth as it casts its shadow [m]
        sun_radius: () [m]
        astronomical_unit: () distance at which the flux is stated [m]
    """

    flux: Array
    shadow_radius: Array | float = RADIUS_EARTH
    sun_radius: Array | float = RADIUS_SUN
    astronomical_unit: Array | float = ASTRONOMICAL_UNIT


@pytree
class Surface:
    """What air and light push on: a sphere about the centre of pressure.

    Attributes:
        area: () [m^2]
        drag_coefficient: () [-]
        pressure_coefficient: () of sunlight, 1 absorbs, 2 reflects all [-]
        center_of_pressure: (3,) from the centre of mass, body axes [m]
    """

    area: Array
    drag_coefficient: Array
    pressure_coefficient: Array
    center_of_pressure: Array


def drag(atmosphere: Atmosphere, surface: Surface, earth_radius: Scalar | float, r_N: Vector, v_N: Vector) -> Vector:
    """Force of the air [N] in N on a surface at an inertial position [m] and velocity [m/s].

    Vallado, Fundamentals of Astrodynamics and Applications, section 8.6.2.
    """
    height = jnp.sqrt(jnp.sum(r_N * r_N, axis=0)) - earth_radius - atmosphere.altitude
    density = atmosphere.density * jnp.exp(-height / atmosphere.scale_height)
    wind = atmosphere.rotation * jnp.stack([-r_N[1], r_N[0], jnp.zeros_like(r_N[2])])
    flow = v_N - wind
    return -0.5 * density * surface.drag_coefficient * surface.area * norm(flow) * flow


def sunlit_fraction(sunlight: Sunlight, r_N: Vector, r_sun_N: Vector) -> Scalar:
    """Share of sunlight [-] that the Earth leaves at an inertial position [m]."""
    return illumination(r_N, r_sun_N, sunlight.shadow_radius, sunlight.sun_radius)


def solar_radiation_pressure(
    sunlight: Sunlight, surface: Surface, r_N: Vector, r_sun_N: Vector, sunlit_fraction: Scalar
) -> Vector:
    """Force of sunlight [N] in N on a surface at an inertial position [m], of which the Earth leaves a share [-]."""
    from_sun = r_N - r_sun_N
    square = jnp.sum(from_sun * from_sun, axis=0)
    pressure = sunlight.flux / SPEED_OF_LIGHT * sunlight.astronomical_unit**2 / square
    return sunlit_fraction * pressure * surface.pressure_coefficient * surface.area / jnp.sqrt(square) * from_sun


def gravity_gradient_torque(r_B: Vector, inertia: Float[Array, "3 3"], mu: Scalar | float = MU_EARTH) -> Vector:
    """Torque [N m] of two-body gravity on a body with the given inertia [kg m^2] at position `r_B` [m], body axes.

    Schaub and Junkins, Analytical Mechanics of Space Systems, section 4.5.
    """
    square = jnp.sum(r_B * r_B, axis=0)
    scale = 3.0 * mu / (square * square * jnp.sqrt(square))
    return scale * cross(r_B, apply(inertia, r_B))
