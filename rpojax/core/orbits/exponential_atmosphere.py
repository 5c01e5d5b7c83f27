"""Exponential atmosphere that rotates with the Earth."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class Atmosphere:
    """Exponential atmosphere that rotates about the Earth's pole."""

    density: Array = number("density at the reference altitude", unit="kg_m3", at_least=0.0)
    altitude: Array = number("reference altitude, above the equatorial radius", unit="m")
    scale_height: Array = number("height over which the density falls to 1/e", unit="m", above=0.0)
    rotation: Array = number("rate of the atmosphere about the Earth's axis; 0 if it rests in N", unit="rad_s")


def density_and_flow(
    atmosphere: Atmosphere, earth_radius: Scalar | float, r_N: Vector, v_N: Vector
) -> tuple[Scalar, Vector]:
    """Density [kg/m^3] at an inertial position [m], and the velocity through the air [m/s] of a body with `v_N` [m/s].

    Vallado, Fundamentals of Astrodynamics and Applications, section 8.6.2.
    """
    height = jnp.sqrt(jnp.sum(r_N * r_N, axis=0)) - earth_radius - atmosphere.altitude
    density = atmosphere.density * jnp.exp(-height / atmosphere.scale_height)
    wind = atmosphere.rotation * jnp.stack([-r_N[1], r_N[0], jnp.zeros_like(r_N[2])])
    return density, v_N - wind
