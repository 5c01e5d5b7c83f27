"""Covariance propagation of an orbit's position and velocity with slow states."""

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
        velocity_effects: (3, k) velocity change in it by a unit of each of the last slow states [m/s]; None where
            no slow state acts on the motion
    """

    dt: float
    r_SN_N: Array
    velocity_covariance: Array
    velocity_effects: Array | None = None

    def with_acceleration_noise(self, noise: Float[Array, ""]) -> "OrbitStep":
        """The step with the errors of unmodelled accelerations of a density `noise` [m/s^2 per Hz^0.5], too."""
        identity = jnp.eye(3, dtype=self.velocity_covariance.dtype)
        return replace(self, velocity_covariance=self.velocity_covariance + noise**2 * self.dt * identity)


def propagate(
    P: Float[Array, "n n"],
    step: OrbitStep,
    decay: Float[Array, " m"],
    slow_process_variance: Float[Array, " m"],
) -> Float[Array, "n n"]:
    """Covariance after a step of position, velocity and `m` slow states, in this order.

    `decay` [-] is the factor on each slow state over the step, which has that process variance.
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
    if step.velocity_effects is not None:
        G, acting = step.velocity_effects, slice(ss.shape[0] - step.velocity_effects.shape[1], None)
        added = product(G, ss[acting])
        # Half of the effect before and after: the products are symmetric.
        half_v, half_x = vs[:, acting] + 0.5 * added[:, acting], xs[:, acting] + 0.25 * dt * added[:, acting]
        by_x, by_v = product(half_x, G.T), product(half_v, G.T)
        xx = xx + 0.5 * dt * (by_x + by_x.T)
        xv = xv + (by_x + 0.5 * dt * by_v.T)
        vv = vv + (by_v + by_v.T)
        xs, vs = xs + 0.5 * dt * added, vs + added
    blocks = [[xx, xv, xs], [xv.T, vv + step.velocity_covariance, vs], [xs.T, vs.T, ss]]
    return jnp.concatenate([jnp.concatenate(row, axis=1) for row in blocks], axis=0)
