"""Approach inhibition: a burn whose free motion comes too near the target is replaced by a safer one."""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits.clohessy_wiltshire import transition_matrix
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]

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

_NEAR_STATION_AXIS = 0.7
"""Cosine of the angle between servicer and station above which a hold leads to the line through the station [-]."""

_HOLD_MARGIN = 0.1
"""A hold is farther than the range at which the confidence was lost by this fraction of it, so that no error of a burn
comes nearer [-]."""


@pytree
class Confidence:
    """Confidence in the relative estimate.

    Attributes:
        present: () bool
        last_range: () estimated range when there last was confidence [m]
        range_sigma: () 1-sigma of the range [m]
    """

    present: Array
    last_range: Array
    range_sigma: Array


@pytree
class Approach:
    """Relative motion at the next burn, and where it is to lead.

    Attributes:
        station_H: (3,) desired position [m]
        state_H: (6,) relative state predicted to the middle of the burn [m, m/s]
        stays_visible: () bool, there will be another burn after this one
        n: () mean motion of the target [rad/s]
        period: time between burns [s]
    """

    station_H: Array
    state_H: Array
    stays_visible: Array
    n: Array
    period: float


def inhibit(
    clearance: Scalar, approach: Approach, confidence: Confidence, wanted_H: Vector, certain_delta_v: Scalar
) -> Vector:
    """Velocity change [m/s] of the next burn: the `wanted_H` if it is safe, else half of it, a stop, none or a retreat.

    A burn is safe if the free motion after it stays farther from the target than the fraction `clearance` of the
    station's distance, with a margin for the uncertain range; or than the servicer is, if that is less, so that many
    small burns do not add up to an approach. Without confidence a hold at the present range is wanted instead, and no
    burn comes nearer than the range at which the confidence was lost, or the present one if that is nearer. If nothing
    is safe, the change with the greatest least range is made. A change that is not finite is returned. The last burns
    before the target is out of sight are stops.

    Args:
        clearance: () least range over the station's distance [-]
        approach: relative motion at the burn
        confidence: in the estimate
        wanted_H: (3,) velocity change of the control law [m/s]
        certain_delta_v: () size of a change that a burn can make in any direction; a larger one may be cut [m/s]
    """
    state_H, n = approach.state_H, approach.n
    now, station = gradient_safe.norm(state_H[:3]), gradient_safe.norm(approach.station_H)
    candidates = _candidates(approach, confidence, wanted_H)
    sizes = gradient_safe.sqrt(jnp.sum(candidates * candidates, axis=1))
    cut = certain_delta_v / jnp.maximum(sizes, certain_delta_v)
    horizon = jnp.where(approach.stays_visible, _HORIZON_PERIODS * approach.period, 2.0 * math.pi / n)
    least = jnp.minimum(
        _least_range(n, horizon, state_H[:3], state_H[None, 3:] + candidates),
        _least_range(n, horizon, state_H[:3], state_H[None, 3:] + cut[:, None] * candidates),
    )
    cleared = clearance * station + _SIGMAS * confidence.range_sigma
    nearest = jnp.minimum(now, jnp.where(confidence.present, cleared, confidence.last_range))
    chosen, greatest = candidates[0], least[0]
    for index in range(1, len(candidates)):
        better = least[index] > greatest
        chosen, greatest = jnp.where(better, candidates[index], chosen), jnp.maximum(least[index], greatest)
    for index in reversed(range(len(candidates))):
        chosen = jnp.where(least[index] >= nearest, candidates[index], chosen)
    return jnp.where(jnp.all(jnp.isfinite(wanted_H), axis=0), chosen, wanted_H)


def _candidates(approach: Approach, confidence: Confidence, wanted_H: Vector) -> Float[Array, "7 3"]:
    """Velocity changes [m/s] in the order of preference."""
    state_H, n, rho = approach.state_H, approach.n, approach.state_H[:3]
    now, station = gradient_safe.norm(rho), gradient_safe.norm(approach.station_H)
    stop = change_to_stop(state_H, n)
    caution = jnp.where(confidence.present, 1.0, _HOLD_FRACTION)
    hold = _change_to_hold(approach, confidence.last_range)
    preferred = jnp.where(approach.stays_visible, jnp.where(confidence.present, wanted_H, caution * hold), stop)
    along_track = jnp.stack([0.0 * n, stop[1], 0.0 * n])
    retreat = caution * stop + _RETREAT * jnp.minimum(station, now) / (approach.period * now) * rho
    return jnp.stack([preferred, 0.5 * preferred, caution * stop, jnp.zeros_like(stop), stop, along_track, retreat])


def change_to_stop(state_H: Float[Array, "6"], n: Scalar) -> Vector:
    """Velocity change [m/s] after which the relative motion [m, m/s] does not drift, at mean motion `n` [rad/s]."""
    # Without radial and cross-track velocity this one along the track is that of a closed ellipse.
    return jnp.stack([0.0 * n, -2.0 * n * state_H[0], 0.0 * n]) - state_H[3:]


def _change_to_hold(approach: Approach, last_range: Scalar) -> Vector:
    """Velocity change [m/s] that leads to the line through target and station, at the present range.

    Far from that line the place to hold is the present one.
    """
    n, rho = approach.n, approach.state_H[:3]
    now = gradient_safe.norm(rho)
    station_axis = approach.station_H / gradient_safe.norm(approach.station_H)
    cosine = jnp.sum(station_axis * rho, axis=0) / now
    away = jnp.where(jnp.abs(cosine) > _NEAR_STATION_AXIS, jnp.sign(cosine) * station_axis, rho / now)
    transition = transition_matrix(n, jnp.full_like(n, _HORIZON_PERIODS * approach.period))[:3]
    place = away * jnp.maximum(now, (1.0 + _HOLD_MARGIN) * last_range)
    way = place - jnp.sum(transition[:, :3] * rho[None, :], axis=1)
    a, b, d = transition[0, 3], transition[0, 4], transition[1, 4]
    # In the orbit plane the matrix from velocity to position is ((a, b), (-b, d)).
    in_plane = jnp.stack([d * way[0] - b * way[1], b * way[0] + a * way[1]]) / (a * d + b * b)
    return jnp.concatenate([in_plane, way[2:] / transition[2, 5]]) - approach.state_H[3:]


def _least_range(n: Scalar, horizon: Scalar, rho_H: Vector, rho_dot_H: Float[Array, "k 3"]) -> Float[Array, " k"]:
    """Least range [m] of free motions over a time [s] from one position with several velocities."""

    def sample(least: Float[Array, " k"], time: Scalar) -> tuple[Float[Array, " k"], None]:
        transition = transition_matrix(n, time)[:3]
        rho = jnp.sum(transition[:, :3] * rho_H[None, :], axis=1)
        moved = rho[None, :] + jnp.sum(transition[None, :, 3:] * rho_dot_H[:, None, :], axis=2)
        return jnp.minimum(least, gradient_safe.sqrt(jnp.sum(moved * moved, axis=1))), None

    times = jnp.linspace(1.0 / _SAMPLES, 1.0, _SAMPLES, dtype=n.dtype) * horizon
    return jax.lax.scan(sample, jnp.full_like(rho_dot_H[:, 0], jnp.inf), times)[0]
