"""Covariance propagation of an orbit's position and velocity with slowly varying measurement errors."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.vectors import product

Matrix = Float[Array, "3 3"]


def propagate(
    P: Float[Array, "n n"],
    gravity_gradient: Matrix,
    decay: Float[Array, " m"],
    velocity_process_covariance: Matrix,
    slow_process_variance: Float[Array, " m"],
    dt: float,
    burn: tuple[Float[Array, "6"], Float[Array, " n"]] | None = None,
) -> Float[Array, "n n"]:
    """Covariance after `dt` [s] of position (first three), velocity (next three) and `m` Gauss-Markov errors.

    `gravity_gradient` is in [1/s^2], `decay` [-] the factor on each error; the process noises are those of the step. An
    error common to burns adds `g u' + u g'` with the vectors of `burn`: `g` of position and velocity, `u` of all.
    The transition is a kick followed by a drift, which together are symplectic; over one second they differ from the
    exact transition by parts in a million.
    """
    kick = dt * gravity_gradient
    xx, xv, xs, vv, vs, ss = P[:3, :3], P[:3, 3:6], P[:3, 6:], P[3:6, 3:6], P[3:6, 6:], P[6:, 6:]
    kicked = xv + product(xx, kick.T)
    half = product(kick, 0.5 * (xv + kicked))
    vv = vv + (half + half.T)
    xx = xx + dt * (kicked + kicked.T) + dt * dt * vv
    xv = kicked + dt * vv
    vs = (vs + product(kick, xs)) * decay[None, :]
    xs = xs * decay[None, :] + dt * vs
    ss = ss * (decay[:, None] * decay[None, :]) + jnp.diag(slow_process_variance)
    if burn is not None:
        (g_x, g_v), (u_x, u_v, u_s) = (burn[0][:3], burn[0][3:]), (burn[1][:3], burn[1][3:6], burn[1][6:])
        xx = xx + (_outer(g_x, u_x) + _outer(u_x, g_x))
        xv = xv + (_outer(g_x, u_v) + _outer(u_x, g_v))
        vv = vv + (_outer(g_v, u_v) + _outer(u_v, g_v))
        xs, vs = xs + _outer(g_x, u_s), vs + _outer(g_v, u_s)
    blocks = [[xx, xv, xs], [xv.T, vv + velocity_process_covariance, vs], [xs.T, vs.T, ss]]
    return jnp.concatenate([jnp.concatenate(row, axis=1) for row in blocks], axis=0)


def _outer(a: Float[Array, "3"], b: Float[Array, " k"]) -> Float[Array, "3 k"]:
    return a[:, None] * b[None, :]
