"""Covariance propagation of an orbit's position and velocity with slow states."""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.filter_state_layout import MOTION
from rpojax.core.orbits import gravity_gradient
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import product


@pytree
class OrbitStep:
    """A step of the propagation of an orbit.

    Attributes:
        dt: its length [s]
        r_SN_N: (3,) servicer at its beginning [m]
        velocity_covariance: (3, 3) of the velocity errors that are new in it [m^2/s^2]
        delta_v_N: (3,) velocity change of the servicer whose lasting errors are states [m/s]; None where these are part
            of `velocity_covariance`
    """

    dt: float
    r_SN_N: Array
    velocity_covariance: Array
    delta_v_N: Array | None = None

    def with_acceleration_noise(self, noise: Float[Array, ""]) -> "OrbitStep":
        """The step with the errors of unmodelled accelerations of a density `noise` [m/s^2 per Hz^0.5], too."""
        identity = jnp.eye(3, dtype=self.velocity_covariance.dtype)
        return replace(self, velocity_covariance=self.velocity_covariance + noise**2 * self.dt * identity)


def propagate(
    P: Float[Array, "n n"],
    step: OrbitStep,
    decay: Float[Array, " m"],
    slow_process_variance: Float[Array, " m"],
    burns: Sequence[tuple[int, Float[Array, "3"]]] = (),
) -> Float[Array, "n n"]:
    """Covariance after a step of position, velocity and `m` slow states, in this order.

    `decay` [-] is the factor on each slow state over the step, which has that process variance. `burns` are the slow
    states that act on burns: the place of each in the vector, and the velocity change (3,) [m/s] of the step by a unit
    of it.
    The transition is a kick followed by a drift, which together are symplectic; over one second they differ from the
    exact transition by parts in a million.
    """
    dt = step.dt
    kick = dt * gravity_gradient.gravity_gradient(step.r_SN_N)
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
    blocks = [[xx, xv, xs], [xv.T, vv + step.velocity_covariance, vs], [xs.T, vs.T, ss]]
    return jnp.concatenate([jnp.concatenate(row, axis=1) for row in blocks], axis=0)


def _outer(a: Float[Array, "3"], b: Float[Array, " k"]) -> Float[Array, "3 k"]:
    return a[:, None] * b[None, :]
