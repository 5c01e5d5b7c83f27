"""Orbits as truth and flight software both need them: gravity with J2, its differential form, relative motion."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.constants import J2_EARTH, MU_EARTH, RADIUS_EARTH
from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]

_K2 = 1.5 * J2_EARTH * MU_EARTH * RADIUS_EARTH**2


@pytree
class Elements:
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


def state_from_elements(elements: Elements) -> tuple[Vector, Vector]:
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


def gravity(r_N: Vector) -> Vector:
    """Acceleration [m/s^2] of two-body and J2 gravity at the inertial position [m]."""
    square = jnp.sum(r_N * r_N, axis=0)
    inverse2 = 1.0 / square
    inverse3 = inverse2 * jnp.sqrt(inverse2)
    j2 = _K2 * inverse2 * inverse3
    zz = 5.0 * r_N[2] * r_N[2] * inverse2
    common = -MU_EARTH * inverse3 - j2 * (1.0 - zz)
    return jnp.stack([common * r_N[0], common * r_N[1], (common - 2.0 * j2) * r_N[2]])


def differential_gravity(r_N: Vector, d_N: Vector) -> Vector:
    """Gravity at `r_N + d_N` less gravity at `r_N` [m/s^2], exact at any distance and without cancellation.

    Each power of the ratio of radii is carried as its difference from one: with f_p = (|r + d|/|r|)^-p - 1, the
    recurrence f_{p+q} = f_p + f_q + f_p f_q never subtracts two nearly equal numbers.
    """
    square = jnp.sum(r_N * r_N, axis=0)
    inverse2 = 1.0 / square
    inverse3 = inverse2 * jnp.sqrt(inverse2)
    q = jnp.sum(d_N * (2.0 * r_N + d_N), axis=0) * inverse2
    root = jnp.sqrt(1.0 + q)
    f1 = -q / (root * (1.0 + root))
    f2 = f1 * (2.0 + f1)
    f3 = f1 + f2 + f1 * f2
    f5 = f3 + f2 + f3 * f2
    f7 = f5 + f2 + f5 * f2
    moved = r_N + d_N
    two_body = -MU_EARTH * inverse3 * (d_N + f3 * moved)
    zz = r_N[2] * r_N[2] * inverse2
    zz_moved = moved[2] * moved[2] * inverse2
    zz_change = d_N[2] * (2.0 * r_N[2] + d_N[2]) * inverse2
    in_plane = d_N + f5 * moved - 5.0 * (zz * d_N + (zz_change + zz_moved * f7) * moved)
    along_pole = 2.0 * (d_N[2] + f5 * moved[2])
    j2 = -_K2 * inverse2 * inverse3
    return two_body + j2 * jnp.stack([in_plane[0], in_plane[1], in_plane[2] + along_pole])


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


def relative_transition(n: Scalar, t: Scalar) -> Float[Array, "6 6"]:
    """State transition matrix of (rho, rho_dot) in the Hill frame over `t` [s] at mean motion `n` [rad/s].

    Clohessy and Wiltshire, "Terminal guidance system for satellite rendezvous", 1960.
    """
    s, c = jnp.sin(n * t), jnp.cos(n * t)
    zero, one = jnp.zeros_like(s), jnp.ones_like(s)
    rows = [
        [4 - 3 * c, zero, zero, s / n, 2 / n * (1 - c), zero],
        [6 * (s - n * t), one, zero, -2 / n * (1 - c), (4 * s - 3 * n * t) / n, zero],
        [zero, zero, c, zero, zero, s / n],
        [3 * n * s, zero, zero, c, 2 * s, zero],
        [-6 * n * (1 - c), zero, zero, -2 * s, 4 * c - 3, zero],
        [zero, zero, -n * s, zero, zero, c],
    ]
    return jnp.stack([jnp.stack(row) for row in rows])
