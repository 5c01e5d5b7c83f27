"""Aerodynamic drag on a surface."""

from jaxtyping import Array, Float

from rpojax.core.numerics.gradient_safe import norm
from rpojax.core.orbits.exponential_atmosphere import Atmosphere, density_and_flow
from rpojax.physics.environment.spacecraft_surface import Surface

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


def drag(atmosphere: Atmosphere, surface: Surface, earth_radius: Scalar | float, r_N: Vector, v_N: Vector) -> Vector:
    """Drag force [N] in N at an inertial position [m] and velocity [m/s].

    Vallado, Fundamentals of Astrodynamics and Applications, section 8.6.2.
    """
    density, flow = density_and_flow(atmosphere, earth_radius, r_N, v_N)
    return -0.5 * density * surface.drag_coefficient * surface.area * norm(flow) * flow
