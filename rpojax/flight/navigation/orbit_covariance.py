"""Covariance of position and velocity of an orbit, with slowly varying errors behind them."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import safe

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]


def propagate(
    P: Float[Array, "n n"],
    gravity_gradient: Matrix,
    decay: Float[Array, " m"],
    velocity_process_covariance: Matrix,
    slow_process_variance: Float[Array, " m"],
    dt: float,
) -> Float[Array, "n n"]:
    """Covariance after `dt` [s] of position (first three), velocity (next three) and `m` errors that decay.

    `gradient` [1/s^2] is that of gravity; the step adds `velocity` to the covariance of velocity and `growth` to the
    variances of the slow errors. The transition is a kick followed by a drift, which together are symplectic; over one
    second they differ from the exact transition by parts in a million.
    """
    kick = dt * gravity_gradient
    xx, xv, xs, vv, vs, ss = P[:3, :3], P[:3, 3:6], P[:3, 6:], P[3:6, 3:6], P[3:6, 6:], P[6:, 6:]
    kicked = xv + _matrix_product(xx, kick.T)
    half = _matrix_product(kick, 0.5 * (xv + kicked))
    vv = vv + (half + half.T)
    xx = xx + dt * (kicked + kicked.T) + dt * dt * vv
    xv = kicked + dt * vv
    vs = (vs + _matrix_product(kick, xs)) * decay[None, :]
    xs = xs * decay[None, :] + dt * vs
    ss = ss * (decay[:, None] * decay[None, :]) + jnp.diag(slow_process_variance)
    blocks = [[xx, xv, xs], [xv.T, vv + velocity_process_covariance, vs], [xs.T, vs.T, ss]]
    return jnp.concatenate([jnp.concatenate(row, axis=1) for row in blocks], axis=0)


def _matrix_product(A: Matrix, B: Float[Array, "3 k"]) -> Float[Array, "3 k"]:
    """Matrix product with its sum written out, which the compiler works out for many runs at once."""
    return A[:, :1] * B[:1] + A[:, 1:2] * B[1:2] + A[:, 2:] * B[2:]


def burn_covariance(
    delta_v_N: Vector, burn_delta_v: Scalar, magnitude_sigma: Scalar, direction_sigma: Scalar
) -> Matrix:
    """Velocity covariance [m^2/s^2] of one step's share `delta_v_N` [m/s] of a burn of size `burn_delta_v` [m/s].

    A burn's execution error is one draw for all of its seconds; each second gets its share of the burn's variance, so
    that the sum is right.
    """
    size = safe.norm(delta_v_N)
    along = safe.normalize(delta_v_N)
    projection = along[:, None] * along[None, :]
    across = jnp.eye(3, dtype=delta_v_N.dtype) - projection
    return size * burn_delta_v * (magnitude_sigma**2 * projection + direction_sigma**2 * across)
