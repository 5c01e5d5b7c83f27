"""Covariance propagation of an orbit's position and velocity with slowly varying measurement errors."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Matrix = Float[Array, "3 3"]


def propagate(
    P: Float[Array, "n n"],
    gravity_gradient: Matrix,
    decay: Float[Array, " m"],
    velocity_process_covariance: Matrix,
    slow_process_variance: Float[Array, " m"],
    dt: float,
) -> Float[Array, "n n"]:
    """Covariance after `dt` [s] of position (first three), velocity (next three) and `m` Gauss-Markov errors.

    `gravity_gradient` is in [1/s^2], `decay` [-] the factor on each error; the process noises are those of the step.
    The transition is a kick followed by a drift, which together are symplectic; over one second they differ from the
    exact transition by parts in a million.
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
    """Matrix product as an explicit sum, which the compiler vectorises over a batch of runs."""
    return A[:, :1] * B[:1] + A[:, 1:2] * B[1:2] + A[:, 2:] * B[2:]
