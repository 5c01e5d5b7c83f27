"""Exponential atmosphere that rotates with the Earth."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class Atmosphere:
    """Exponential atmosphere that rotates about the Earth's pole.

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
