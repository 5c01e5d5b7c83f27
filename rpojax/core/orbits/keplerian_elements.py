"""Osculating Keplerian elements of an orbit about the Earth, and quantities that follow from them."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.constants import MU_EARTH
from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class KeplerianElements:
    """Osculating orbital elements."""

    semi_major_axis: Array = number("semi-major axis", unit="m", above=6.5e6, below=1e8)
    eccentricity: Array = number("eccentricity; the perigee must be above 6470 km", at_least=0.0, below=0.9)
    inclination: Array = number("inclination", unit="deg", at_least=0.0, at_most=180.0)
    raan: Array = number("right ascension of the ascending node", unit="deg")
    argument_of_perigee: Array = number("argument of perigee", unit="deg")
    true_anomaly: Array = number("true anomaly", unit="deg")


def state_from_elements(elements: KeplerianElements) -> tuple[Vector, Vector]:
    """Inertial position [m] and velocity [m/s] of an elliptic orbit (Vallado, algorithm 10)."""
    e = elements.eccentricity
    parameter = elements.semi_major_axis * (1.0 - e * e)
    cos_nu, sin_nu = jnp.cos(elements.true_anomaly), jnp.sin(elements.true_anomaly)
    radius = parameter / (1.0 + e * cos_nu)
    speed = jnp.sqrt(MU_EARTH / parameter)
    cos_o, sin_o = jnp.cos(elements.raan), jnp.sin(elements.raan)
    cos_i, sin_i = jnp.cos(elements.inclination), jnp.sin(elements.inclination)
    cos_w, sin_w = jnp.cos(elements.argument_of_perigee), jnp.sin(elements.argument_of_perigee)
    p = jnp.stack([cos_o * cos_w - sin_o * sin_w * cos_i, sin_o * cos_w + cos_o * sin_w * cos_i, sin_w * sin_i])
    q = jnp.stack([-cos_o * sin_w - sin_o * cos_w * cos_i, -sin_o * sin_w + cos_o * cos_w * cos_i, cos_w * sin_i])
    return radius * (cos_nu * p + sin_nu * q), speed * (-sin_nu * p + (e + cos_nu) * q)


def mean_motion(semi_major_axis: Scalar) -> Scalar:
    """Mean motion [rad/s] of an orbit with the given semi-major axis [m]."""
    return jnp.sqrt(MU_EARTH / semi_major_axis**3)


def semi_major_axis(r_N: Vector, v_N: Vector) -> Scalar:
    """Osculating semi-major axis [m] by the vis-viva equation."""
    return 1.0 / (2.0 / jnp.sqrt(jnp.sum(r_N * r_N, axis=0)) - jnp.sum(v_N * v_N, axis=0) / MU_EARTH)
