"""Unit quaternions, scalar first, Hamilton: `q_BN` turns N components into B components, `R(q) v = q (0, v) q*`."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import arctan2, cos_sinc
from rpojax.core.vectors import cross

Quaternion = Float[Array, "4"]
Vector = Float[Array, "3"]


def multiply(q: Quaternion, p: Quaternion) -> Quaternion:
    """Hamilton product `q p`, so that `q_CA = multiply(q_CB, q_BA)`."""
    a, b, c, d = q[0], q[1], q[2], q[3]
    e, f, g, h = p[0], p[1], p[2], p[3]
    return jnp.stack(
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ]
    )


def conjugate(q: Quaternion) -> Quaternion:
    """Inverse rotation of a unit quaternion: `q_NB = conjugate(q_BN)`."""
    return jnp.stack([q[0], -q[1], -q[2], -q[3]])


def normalize(q: Float[Array, " n"]) -> Float[Array, " n"]:
    """Unit quaternion along `q`."""
    return q / jnp.sqrt(jnp.sum(q * q, axis=0))


def rotate(q: Quaternion, vector: Vector) -> Vector:
    """Components `R(q) v` of a vector: `v_B = rotate(q_BN, v_N)`."""
    u = q[1:]
    t = 2.0 * cross(u, vector)
    return vector + q[0] * t + cross(u, t)


def to_matrix(q: Quaternion) -> Float[Array, "3 3"]:
    """Direction cosine matrix `R(q)`."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return jnp.stack(
        [
            jnp.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)]),
            jnp.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)]),
            jnp.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]),
        ]
    )


def from_matrix(matrix: Float[Array, "3 3"]) -> Quaternion:
    """Unit quaternion of a direction cosine matrix, by the best conditioned of Shepperd's four forms."""
    m = matrix
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    squares = jnp.stack([trace, m[0, 0], m[1, 1], m[2, 2]])
    skew = jnp.stack([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    sxy, sxz, syz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    forms = [
        jnp.stack([1 + trace, skew[0], skew[1], skew[2]]),
        jnp.stack([skew[0], 1 + 2 * m[0, 0] - trace, sxy, sxz]),
        jnp.stack([skew[1], sxy, 1 + 2 * m[1, 1] - trace, syz]),
        jnp.stack([skew[2], sxz, syz, 1 + 2 * m[2, 2] - trace]),
    ]
    best = jnp.max(squares, axis=0)
    chosen = forms[3]
    for index in (2, 1, 0):
        chosen = jnp.where(squares[index] >= best, forms[index], chosen)
    return normalize(chosen)


def exp(rotation: Vector) -> Quaternion:
    """Quaternion of a rotation vector [rad] of at most one full turn.

    `R(exp(phi)) v` is v rotated by |phi| about phi.
    """
    cosine, sinc = cos_sinc(0.25 * jnp.sum(rotation * rotation, axis=0))
    return jnp.concatenate([cosine[None], 0.5 * sinc * rotation])


def log(q: Quaternion) -> Vector:
    """Rotation vector [rad] of at most half a turn, inverse of `exp`."""
    sign = jnp.where(q[0] < 0.0, -1.0, 1.0)
    w, u = sign * q[0], sign * q[1:]
    square = jnp.sum(u * u, axis=0)
    small = square < 1e-12
    sine = jnp.sqrt(jnp.where(small, 1.0, square))
    scale = jnp.where(small, 2.0 - square / 3.0, 2.0 * arctan2(sine, w) / sine)
    return scale * u


def rotation_vector_between(a: Vector, b: Vector) -> Vector:
    """Rotation vector [rad] of the smallest rotation that takes unit vector `a` to unit vector `b`.

    The axis for opposite vectors is not unique: it is chosen from the coordinate axis most normal to `a`.
    """
    axis = cross(a, b)
    sine, cosine = gradient_safe.norm(axis), jnp.sum(a * b, axis=0)
    least = jnp.argmin(jnp.abs(a), axis=0)
    fallback = cross(a, jnp.where(jnp.arange(3) == least, 1.0, 0.0).astype(a.dtype))
    angle = arctan2(sine, cosine)
    small = sine < 1e-9
    # Angle over sine tends to one for equal vectors.
    ratio = jnp.where(small, 1.0, angle / jnp.where(small, 1.0, sine))
    return jnp.where(small & (cosine < 0.0), angle * gradient_safe.normalize(fallback), ratio * axis)


def derivative(q_BN: Quaternion, omega_BN_B: Vector) -> Quaternion:
    """Time derivative of `q_BN` [1/s] for the rate `omega_BN_B` [rad/s]: `-1/2 (0, omega) q`."""
    zero = jnp.zeros_like(omega_BN_B[:1])
    return -0.5 * multiply(jnp.concatenate([zero, omega_BN_B]), q_BN)


def propagate(q_BN: Quaternion, omega_BN_B: Vector, dt: float | Float[Array, ""]) -> Quaternion:
    """`q_BN` after `dt` [s] at the constant rate `omega_BN_B` [rad/s], exactly."""
    return multiply(exp(-dt * omega_BN_B), q_BN)
