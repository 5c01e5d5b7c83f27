"""Orbits as truth and flight software both need them: gravity, its differential form, relative motion."""

from typing import Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.constants import MU_EARTH, RADIUS_EARTH, ZONALS_EARTH
from rpojax.core.numerics.exact_difference import Difference, inverse_norm
from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class GravityField:
    """The Earth's gravity.

    Attributes:
        mu: () gravitational parameter [m^3/s^2]
        radius: () equatorial radius that the harmonics refer to [m]
        zonals: (n,) J2 and up, unnormalised [-]
    """

    mu: Array | float
    radius: Array | float
    zonals: Array | tuple[float, ...]


EARTH_GRAVITY: Final = GravityField(mu=MU_EARTH, radius=RADIUS_EARTH, zonals=ZONALS_EARTH)
"""The field as it is known to all."""


@pytree
class KeplerianElements:
    """Osculating orbital elements.

    Attributes:
        semi_major_axis: () [m]
        eccentricity: () [-]
        inclination: () [rad]
        raan: () right ascension of the ascending node [rad]
        argument_of_perigee: () [rad]
        true_anomaly: () [rad]
    """

    semi_major_axis: Array
    eccentricity: Array
    inclination: Array
    raan: Array
    argument_of_perigee: Array
    true_anomaly: Array


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


def gravity(field: GravityField, degree: int, r: Difference) -> Difference:
    """Acceleration [m/s^2] at an inertial position [m], with zonal harmonics up to `degree` (0: a point mass).

    The change of `r` gives the difference of gravity between two craft, exact at any distance and without cancellation.
    Each harmonic pulls along the radius with P'_{n+1} and along the pole with P'_n of the sine of latitude, derivatives
    of Legendre polynomials that follow from one another (Kaula, Theory of Satellite Geodesy, 1966, in vector form).
    """
    return _acceleration(field, degree, r, two_body=1.0)


def zonal_acceleration(field: GravityField, degree: int, r: Difference) -> Difference:
    """The same without the two-body pull."""
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
    """Sums over the harmonics of J_n (R/r)^n P'_{n+1} and J_n (R/r)^n P'_n, relative to the two-body pull."""
    zero = jnp.zeros_like(inverse.value)
    radial = polar = Difference(value=zero, change=zero)
    ratio = inverse * field.radius
    power, slope_before, slope = ratio, Difference(value=zero + 1.0, change=zero), sine * 3.0  # P'_1, P'_2
    for n in range(2, degree + 1):
        power = power * ratio
        slope_after = (sine * slope) * (2.0 + 1.0 / n) - slope_before * (1.0 + 1.0 / n)
        weight = power * field.zonals[n - 2]
        radial, polar = radial + weight * slope_after, polar + weight * slope
        slope_before, slope = slope, slope_after
    return radial, polar


def third_body_acceleration(mu: float, r_body_N: Vector, r: Difference) -> Difference:
    """Pull [m/s^2] of a distant body at `r_body_N` [m], less its pull on the Earth, at an inertial position [m].

    The pull at the position less that at the Earth's centre is itself a difference, over the position vector.
    """
    from_earth = _point_mass(mu, Difference(value=-r_body_N, change=r.value))
    between = _point_mass(mu, Difference(value=r.value - r_body_N, change=r.change))
    return Difference(value=from_earth.change, change=between.change)


def _point_mass(mu: float, d: Difference) -> Difference:
    inverse = inverse_norm(d)
    return (inverse * inverse * inverse * -mu).scale(d)


def gravity_gradient(r_N: Vector) -> Float[Array, "3 3"]:
    """Derivative of two-body gravity to position [1/s^2] (J2 changes it by a part in a thousand)."""
    square = jnp.sum(r_N * r_N, axis=0)
    inverse2 = 1.0 / square
    scale = MU_EARTH * inverse2 * jnp.sqrt(inverse2)
    identity = jnp.eye(3, dtype=r_N.dtype)
    return scale * (3.0 * inverse2 * r_N[:, None] * r_N[None, :] - identity)


def mean_motion(semi_major_axis: Scalar) -> Scalar:
    """Mean motion [rad/s] of an orbit with the given semi-major axis [m]."""
    return jnp.sqrt(MU_EARTH / semi_major_axis**3)


def semi_major_axis(r_N: Vector, v_N: Vector) -> Scalar:
    """Osculating semi-major axis [m] by the vis-viva equation."""
    return 1.0 / (2.0 / jnp.sqrt(jnp.sum(r_N * r_N, axis=0)) - jnp.sum(v_N * v_N, axis=0) / MU_EARTH)


def transition_matrix(n: Scalar, t: Scalar) -> Float[Array, "6 6"]:
    """State transition matrix of (rho, rho_dot) in the Hill frame over `t` [s] at mean motion `n` [rad/s].

    Clohessy and Wiltshire, "Terminal guidance system for satellite rendezvous", 1960.
    """
    angle = n * t
    return _transition_over_angle(n, angle, jnp.sin(angle), jnp.cos(angle))


def _transition_over_angle(n: Scalar, angle: Scalar, s: Scalar, c: Scalar) -> Float[Array, "6 6"]:
    """The same over an `angle` of the orbit [rad] with sine `s` and cosine `c`."""
    zero, one = jnp.zeros_like(s), jnp.ones_like(s)
    rows = [
        [4 - 3 * c, zero, zero, s / n, 2 / n * (1 - c), zero],
        [6 * (s - angle), one, zero, -2 / n * (1 - c), (4 * s - 3 * angle) / n, zero],
        [zero, zero, c, zero, zero, s / n],
        [3 * n * s, zero, zero, c, 2 * s, zero],
        [-6 * n * (1 - c), zero, zero, -2 * s, 4 * c - 3, zero],
        [zero, zero, -n * s, zero, zero, c],
    ]
    return jnp.stack([jnp.stack(row) for row in rows])


def minimum_drift_distance(n: Scalar, rho_H: Vector, rho_dot_H: Vector) -> Scalar:
    """Least distance [m] over one orbit of free relative motion from the given state [m, m/s] in the Hill frame.

    Clohessy-Wiltshire motion at mean motion `n` [rad/s], looked at every five degrees of orbit.
    """
    angle = np.radians(np.arange(0.0, 361.0, 5.0))
    state = jnp.concatenate([rho_H, rho_dot_H])
    transitions = jax.vmap(_transition_over_angle, in_axes=(None, 0, 0, 0))(
        n, *map(jnp.asarray, (angle, np.sin(angle), np.cos(angle)))
    )
    rho = jnp.sum(transitions[:, :3] * state[None, None, :], axis=2)
    return jnp.sqrt(jnp.min(jnp.sum(rho * rho, axis=1), axis=0))
