"""Approach inhibition: a burn whose free motion comes too near the target is replaced by a safer one."""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits.clohessy_wiltshire import transition_matrix

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Flag = Bool[Array, ""]

_HORIZON_PERIODS = 2.0
"""Free motion that is looked at, in periods between burns: the next burn may have to be left out [-]."""

_SAMPLES = 24
"""Evenly spaced points of that motion."""

_SIGMAS = 2.0
"""Range uncertainty that is subtracted from the least range, in sigmas [-]."""

_RETREAT = 0.25
"""Way of a retreat until the next burn, over the station's distance [-]."""

_HOLD_FRACTION = 0.5
"""Part of the change to a hold that is made without confidence: converges if the range is believed thrice too large."""


def inhibit(
    clearance: Scalar,
    station_H: Vector,
    state_H: Float[Array, "6"],
    range_sigma: Scalar,
    wanted_H: Vector,
    certain_delta_v: Scalar,
    confident: Flag,
    stays_visible: Flag,
    n: Scalar,
    period: float,
) -> Vector:
    """Velocity change [m/s] of the next burn: the `wanted_H` if it is safe, else half of it, a hold, none or a retreat.

    A burn is safe if the free motion after it stays farther from the target than the fraction `clearance` of the
    distance of the `station_H` [m], with a margin for the uncertain range. If the estimate is not `confident`, it must
    not come nearer than it is now. If nothing is safe, the change with the greatest least range is made. A change that
    is not finite is returned. The last burns before the target is out of sight are holds.

    Args:
        clearance: () least range over the station's distance [-]
        station_H: (3,) desired position [m]
        state_H: (6,) relative state predicted to the middle of the burn [m, m/s]
        range_sigma: () 1-sigma of the range [m]
        wanted_H: (3,) velocity change of the control law [m/s]
        certain_delta_v: () size of a change that a burn can make in any direction; a larger one may be cut [m/s]
        confident: () bool
        stays_visible: () bool, there will be another burn after this one
        n: () mean motion of the target [rad/s]
        period: time between burns [s]
    """
    rho, rho_dot = state_H[:3], state_H[3:]
    now, station = gradient_safe.norm(rho), gradient_safe.norm(station_H)
    # Without radial and cross-track velocity and with this one along the track, the relative motion does not drift.
    stop = jnp.stack([0.0 * n, -2.0 * n * rho[0], 0.0 * n]) - rho_dot
    preferred = jnp.where(stays_visible, wanted_H, stop)
    hold = jnp.where(confident, 1.0, _HOLD_FRACTION) * stop
    retreat = stop + _RETREAT * jnp.minimum(station, now) / (period * now) * rho
    along_track = jnp.stack([0.0 * n, stop[1], 0.0 * n])
    candidates = jnp.stack([preferred, 0.5 * preferred, hold, jnp.zeros_like(hold), stop, along_track, retreat])
    sizes = gradient_safe.sqrt(jnp.sum(candidates * candidates, axis=1))
    cut = certain_delta_v / jnp.maximum(sizes, certain_delta_v)
    horizon = jnp.where(stays_visible, _HORIZON_PERIODS * period, 2.0 * math.pi / n)
    least = jnp.minimum(
        _least_range(n, horizon, rho, rho_dot[None, :] + candidates),
        _least_range(n, horizon, rho, rho_dot[None, :] + cut[:, None] * candidates),
    )
    # On the way out to a far station the present distance counts.
    nearest = jnp.where(confident, clearance * jnp.minimum(station, now) + _SIGMAS * range_sigma, now)
    chosen, greatest = candidates[0], least[0]
    for index in range(1, len(candidates)):
        better = least[index] > greatest
        chosen, greatest = jnp.where(better, candidates[index], chosen), jnp.maximum(least[index], greatest)
    for index in reversed(range(len(candidates))):
        chosen = jnp.where(least[index] >= nearest, candidates[index], chosen)
    return jnp.where(jnp.all(jnp.isfinite(wanted_H), axis=0), chosen, wanted_H)


def _least_range(n: Scalar, horizon: Scalar, rho_H: Vector, rho_dot_H: Float[Array, "k 3"]) -> Float[Array, " k"]:
    """Least range [m] of free motions over a time [s] from one position with several velocities."""

    def sample(least: Float[Array, " k"], time: Scalar) -> tuple[Float[Array, " k"], None]:
        transition = transition_matrix(n, time)[:3]
        rho = jnp.sum(transition[:, :3] * rho_H[None, :], axis=1)
        moved = rho[None, :] + jnp.sum(transition[None, :, 3:] * rho_dot_H[:, None, :], axis=2)
        return jnp.minimum(least, gradient_safe.sqrt(jnp.sum(moved * moved, axis=1))), None

    times = jnp.linspace(1.0 / _SAMPLES, 1.0, _SAMPLES, dtype=n.dtype) * horizon
    return jax.lax.scan(sample, jnp.full_like(rho_dot_H[:, 0], jnp.inf), times)[0]
