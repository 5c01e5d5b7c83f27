"""Gravity of the Earth with its zonal harmonics (J2 and up), at one point or as the difference between two points."""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array

from rpojax.core.constants import MU_EARTH, RADIUS_EARTH, ZONALS_EARTH
from rpojax.core.numerics.exact_difference import Difference, inverse_norm
from rpojax.core.pytree import pytree


@pytree
class GravityField:
    """Gravity field of the Earth.

    Attributes:
        mu: () gravitational parameter [m^3/s^2]
        radius: () equatorial radius that the harmonics refer to [m]
        zonals: (n,) J2 and up, unnormalised [-]
    """

    mu: Array | float
    radius: Array | float
    zonals: Array | tuple[float, ...]


EARTH_GRAVITY: Final = GravityField(mu=MU_EARTH, radius=RADIUS_EARTH, zonals=ZONALS_EARTH)
"""The nominal field, with J2 to J6."""


def gravity(field: GravityField, degree: int, r: Difference) -> Difference:
    """Acceleration [m/s^2] at an inertial position [m], with zonal harmonics up to `degree` (0: a point mass).

    The change of `r` gives the difference of gravity between two spacecraft, at any distance and without cancellation.
    Each harmonic acts along the radius with P'_{n+1} and along the pole with P'_n of the sine of latitude, derivatives
    of Legendre polynomials from their recurrence (Kaula, Theory of Satellite Geodesy, 1966, in vector form).
    """
    return _acceleration(field, degree, r, two_body=1.0)


def zonal_acceleration(field: GravityField, degree: int, r: Difference) -> Difference:
    """The part of `gravity` that the zonal harmonics cause, without the point mass."""
    return _acceleration(field, degree, r, two_body=0.0)


def _acceleration(field: GravityField, degree: int, r: Difference, two_body: float) -> Difference:
    inverse = inverse_norm(r)
    along_radius, along_pole = _zonal_sums(field, degree, inverse, r[2] * inverse)
    strength = (inverse * inverse) * field.mu
    outward = strength * (along_radius - two_body) * inverse
    polar = strength * along_pole
    acceleration = outward.scale(r)
    pole = jnp.array([0.0, 0.0, 1.0], dtype=r.value.dtype)
    return Difference(value=acceleration.value - polar.value * pole, change=acceleration.change - polar.change * pole)


def _zonal_sums(
    field: GravityField, degree: int, inverse: Difference, sine: Difference
) -> tuple[Difference, Difference]:
    """Sums over the harmonics of J_n (R/r)^n P'_{n+1} and J_n (R/r)^n P'_n, relative to two-body gravity."""
    zero = jnp.zeros_like(inverse.value)
    radial = polar = Difference(value=zero, change=zero)
    ratio = inverse * field.radius
    power, previous, current = ratio, Difference(value=zero + 1.0, change=zero), sine * 3.0  # P'_1, P'_2
    for n in range(2, degree + 1):
        power = power * ratio
        following = (sine * current) * (2.0 + 1.0 / n) - previous * (1.0 + 1.0 / n)
        weight = power * field.zonals[n - 2]
        radial, polar = radial + weight * following, polar + weight * current
        previous, current = current, following
    return radial, polar
