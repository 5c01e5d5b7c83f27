"""Covariance propagation of an orbit's position and velocity with slow states."""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.state_layout import MOTION
from rpojax.core.vectors import product

Matrix = Float[Array, "3 3"]


def propagate(
    P: Float[Array, "n n"],
    gravity_gradient: Matrix,
    decay: Float[Array, " m"],
    velocity_process_covariance: Matrix,
    slow_process_variance: Float[Array, " m"],
    dt: float,
    burns: Sequence[tuple[int, Float[Array, "3"]]] = (),
) -> Float[Array, "n n"]:
    """Covariance after `dt` [s] of position, velocity and `m` slow states, in this order.

    `gravity_gradient` is in [1/s^2], `decay` [-] the factor on each slow state; the process noises are those of the
    step. `burns` are the slow states that act on burns: the place of each in the vector, and the velocity change (3,)
    [m/s] of the step by a unit of it.
    The transition is a kick followed by a drift, which together are symplectic; over one second they differ from the
    exact transition by parts in a million.
    """
    kick = dt * gravity_gradient
    x, v, s = MOTION["position"], MOTION["velocity"], slice(MOTION.size, None)
    xx, xv, xs, vv, vs, ss = P[x, x], P[x, v], P[x, s], P[v, v], P[v, s], P[s, s]
    kicked = xv + product(xx, kick.T)
    half = product(kick, 0.5 * (xv + kicked))
    vv = vv + (half + half.T)
    xx = xx + dt * (kicked + kicked.T) + dt * dt * vv
    xv = kicked + dt * vv
    vs = (vs + product(kick, xs)) * decay[None, :]
    xs = xs * decay[None, :] + dt * vs
    ss = ss * (decay[:, None] * decay[None, :]) + jnp.diag(slow_process_variance)
    for place, g_v in burns:
        column = place - MOTION.size
        g_x, variance = 0.5 * dt * g_v, ss[column, column]
        u_x, u_v = xs[:, column] + 0.5 * variance * g_x, vs[:, column] + 0.5 * variance * g_v
        xx = xx + (_outer(g_x, u_x) + _outer(u_x, g_x))
        xv = xv + (_outer(g_x, u_v) + _outer(u_x, g_v))
        vv = vv + (_outer(g_v, u_v) + _outer(u_v, g_v))
        xs, vs = xs + _outer(g_x, ss[column]), vs + _outer(g_v, ss[column])
    blocks = [[xx, xv, xs], [xv.T, vv + velocity_process_covariance, vs], [xs.T, vs.T, ss]]
    return jnp.concatenate([jnp.concatenate(row, axis=1) for row in blocks], axis=0)


def _outer(a: Float[Array, "3"], b: Float[Array, " k"]) -> Float[Array, "3 k"]:
    return a[:, None] * b[None, :]
