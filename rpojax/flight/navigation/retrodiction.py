"""Late measurements in the filter: the estimate is taken back to their exposure, updated there, and taken forward.

Over the delay the target moves from the servicer in a straight line but for the velocity changes that flight software
commanded, which it remembers as it does the attitude. That is an affine map of the state with an inverse, so that
every update is that of a filter at the exposure, whatever the order in which measurements arrive. Left out are the
gravity gradient (at 100 m and 1 s delay 0.2 mm, with the range and the square of the delay), the process noise of the
delay, and what the filter knows of lasting errors of burns. Bar-Shalom, Chen, "One-Step
Solution for the Multistep Out-of-Sequence-Measurement Problem in Tracking", 2004, has the same with the noise.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree, replace
from rpojax.flight.navigation import target_attitude_ekf
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class History:
    """What flight software remembers of the last ticks, the latest first.

    Attributes:
        q_BN: (n, 4) attitude at the beginning of the tick, by the attitude filter
        delta_v_N: (n, 3) velocity change over the tick [m/s]
    """

    q_BN: Array
    delta_v_N: Array


@pytree
class Exposure:
    """Exposure of a measurement, seen from the time at which the filter gets it.

    Attributes:
        age: () time since then [s]
        q_BN: (4,) attitude of the servicer then
        moved_N: (3,) what velocity changes since then add to the way back from now with the velocity of now [m]
        changed_N: (3,) what these changed the servicer's velocity by [m/s]
    """

    age: Array
    q_BN: Array
    moved_N: Array
    changed_N: Array


def no_history(ticks: int, q_BN: Float[Array, "4"]) -> History:
    """History of a servicer that has held its attitude for a number of ticks."""
    return History(q_BN=jnp.broadcast_to(q_BN[None, :], (ticks, 4)), delta_v_N=jnp.zeros((ticks, 3), dtype=q_BN.dtype))


def remember(history: History, q_BN: Float[Array, "4"], delta_v_N: Vector) -> History:
    """History after a tick that began with an attitude and changed the velocity [m/s]."""
    return History(
        q_BN=jnp.concatenate([q_BN[None, :], history.q_BN[:-1]]),
        delta_v_N=jnp.concatenate([delta_v_N[None, :], history.delta_v_N[:-1]]),
    )


def exposure(history: History, q_BN: Float[Array, "4"], age: Scalar, tick_s: float) -> Exposure:
    """Exposure that was `age` [s] ago, with the present attitude; an older one than remembered counts as the oldest.

    Velocity changes are spread over their ticks, and the attitude is interpolated between them.
    """
    ticks = history.q_BN.shape[0]
    ago = jnp.arange(ticks + 1, dtype=age.dtype)
    elapsed = jnp.clip(age / tick_s, 0.0, ticks)
    attitudes = jnp.concatenate([q_BN[None, :], history.q_BN])
    near = jnp.maximum(1.0 - jnp.abs(elapsed - ago), 0.0)
    # The two signs of a quaternion are one attitude.
    sign = jnp.where(jnp.sum(attitudes * q_BN[None, :], axis=1) < 0.0, -1.0, 1.0)
    share = jnp.clip(elapsed - ago[:-1], 0.0, 1.0)
    since = tick_s * (0.5 * share**2 + jnp.maximum(elapsed - ago[1:], 0.0))
    return Exposure(
        age=elapsed * tick_s,
        q_BN=quaternion.normalize(jnp.sum((near * sign)[:, None] * attitudes, axis=0)),
        moved_N=-jnp.sum(since[:, None] * history.delta_v_N, axis=0),
        changed_N=jnp.sum(share[:, None] * history.delta_v_N, axis=0),
    )


def to_exposure(estimate: RelativeEstimate, at: Exposure | None) -> RelativeEstimate:
    """Estimate at an exposure, from that of now; without one that of now."""
    if at is None:
        return estimate
    earlier = replace(
        estimate,
        r_TS_N=estimate.r_TS_N - at.age * estimate.v_TS_N + at.moved_N,
        v_TS_N=estimate.v_TS_N + at.changed_N,
        covariance=_sheared(estimate, -at.age),
    )
    return _turned(earlier, -at.age)


def from_exposure(estimate: RelativeEstimate, at: Exposure | None) -> RelativeEstimate:
    """Estimate of now, from that at an exposure: the inverse of `to_exposure`."""
    if at is None:
        return estimate
    v_TS_N = estimate.v_TS_N - at.changed_N
    later = replace(
        estimate,
        r_TS_N=estimate.r_TS_N + at.age * v_TS_N - at.moved_N,
        v_TS_N=v_TS_N,
        covariance=_sheared(estimate, at.age),
    )
    return _turned(later, at.age)


def _turned(estimate: RelativeEstimate, dt: Scalar) -> RelativeEstimate:
    """Estimate where the target has turned for `dt` [s]."""
    if estimate.target is None:
        return estimate
    target, slow, covariance = target_attitude_ekf.turned_by(
        estimate.target, estimate.layout, estimate.slow, estimate.covariance, dt
    )
    return replace(estimate, target=target, slow=slow, covariance=covariance)


def _sheared(estimate: RelativeEstimate, dt: Scalar) -> Float[Array, "n n"]:
    """Covariance where the position has moved by the velocity times `dt` [s]."""
    P, position, velocity = estimate.covariance, estimate.layout["position"], estimate.layout["velocity"]
    P = P.at[position].add(dt * P[velocity])
    return P.at[:, position].add(dt * P[:, velocity])
