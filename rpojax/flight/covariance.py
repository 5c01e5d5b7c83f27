"""Covariance of position and velocity of an orbit, with slowly varying errors behind them."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import safe

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]


def propagate(P: Float[Array, "n n"], gradient: Matrix, decay: Float[Array, " m"], dt: float) -> Float[Array, "n n"]:
    """Covariance after `dt` [s] of position (first three), velocity (next three) and `m` errors that decay.

    `gradient` [1/s^2] is that of gravity. The transition is a kick followed by a drift, which together are symplectic;
    over one second they differ from the exact transition by parts in a million.
    """
    kick = dt * gradient

    def transition(P: Array) -> Array:
        position, velocity, rest = P[:3], P[3:6], P[6:]
        velocity = velocity + jnp.sum(kick[:, :, None] * position[None, :, :], axis=1)
        return jnp.concatenate([position + dt * velocity, velocity, decay[:, None] * rest], axis=0)

    return transition(transition(P).T)


def process_noise(velocity: Matrix, growth: Float[Array, " m"]) -> Float[Array, "n n"]:
    """Covariance added in a step: `velocity` (3, 3) on the velocity, `growth` (m,) on the slowly varying errors."""
    count = growth.shape[0]
    return jnp.pad(velocity, ((3, count), (3, count))) + jnp.diag(jnp.pad(growth, (6, 0)))


def burn(delta_v_N: Vector, burn_delta_v: Scalar, magnitude_sigma: Scalar, direction_sigma: Scalar) -> Matrix:
    """Velocity covariance [m^2/s^2] of one step's share `delta_v_N` [m/s] of a burn of size `burn_delta_v` [m/s].

    A burn's execution error is one draw for all of its seconds; each second gets its share of the burn's variance, so
    that the sum is right.
    """
    size = safe.norm(delta_v_N)
    along = safe.normalize(delta_v_N)
    projection = along[:, None] * along[None, :]
    across = jnp.eye(3, dtype=delta_v_N.dtype) - projection
    return size * burn_delta_v * (magnitude_sigma**2 * projection + direction_sigma**2 * across)
