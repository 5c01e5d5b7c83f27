"""Joint filter of one servicer: the target relative to it, the baselines to its peers, and the errors of all views.

State: the twelve of `relative_orbit_ekf`, then fifteen for each peer: its position and velocity from this servicer in
N (6); size error of its boxes, slow and fast part (2); bearing bias of its camera (2); offset of its box centres (2);
slow error of the difference of GPS positions (3). A box of a peer measures the target from this servicer less the
baseline.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update
from rpojax.core.kalman_update import KalmanUpdate, MeasurementRows
from rpojax.core.pytree import pytree, replace
from rpojax.flight.cooperation import baseline_motion
from rpojax.flight.cooperation.burn_effect import BurnEffect
from rpojax.flight.cooperation.free_relative_motion import apply, product
from rpojax.flight.cooperation.link_settings import BaselineTuning
from rpojax.flight.navigation import outline_correlation, relative_orbit_ekf, shape_errors
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.relative_orbit_ekf import RelativeEstimate

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]
Flag = Bool[Array, ""]

OWN = 12
"""States of the servicer's own filter."""
PEER = 15
"""States of each peer."""


@pytree
class JointEstimate:
    """Mean and covariance of the joint state.

    Attributes:
        own: estimate of the target by this servicer; its covariance is a block of that of all
        peers: (peers, 15) mean of the states of the peers
        covariance: (n, n)
    """

    own: RelativeEstimate
    peers: Array
    covariance: Array


def own_estimate(estimate: JointEstimate) -> RelativeEstimate:
    """Estimate of the target relative to this servicer, with its covariance."""
    return replace(estimate.own, covariance=estimate.covariance[:OWN, :OWN])


def initial(
    tuning: OrbitFilterTuning,
    baseline: BaselineTuning,
    own: RelativeEstimate,
    baselines: Float[Array, "peers 6"],
    peer_tuning: OrbitFilterTuning,
) -> JointEstimate:
    """Estimate at hand-over, with the first baselines [m, m/s]; the tuning of the peers has a leading axis."""
    count = baselines.shape[0]
    size = OWN + PEER * count
    variance = [jnp.zeros(OWN, dtype=baselines.dtype)]
    for k in range(count):
        of = jax.tree.map(lambda leaf, k=k: leaf[k], peer_tuning)
        distance = own.r_TS_N - baselines[k, :3]
        variance += [
            baseline_motion.initial_variance(tuning, of),
            shape_errors.scale_variance(of),
            jnp.full(2, of.bearing_bias_sigma**2),
            jnp.full(2, shape_errors.center_variance(of, own.scale[0], distance)),
            jnp.full(3, baseline.error_sigma**2),
        ]
    P = jnp.pad(own.covariance, ((0, size - OWN), (0, size - OWN))) + jnp.diag(jnp.concatenate(variance))
    P = P + tuning.target_size_sigma**2 * _common_sizes(count).astype(P.dtype)
    peers = jnp.concatenate([baselines, jnp.zeros((count, 9), dtype=baselines.dtype)], axis=1)
    return JointEstimate(own=own, peers=peers, covariance=P)


def _common_sizes(count: int) -> Float[Array, "n n"]:
    """Ones where the size errors of two views meet: all are of one target, whose size is wrong for all alike."""
    is_size = np.zeros(OWN + PEER * count)
    is_size[[6, *(OWN + PEER * k + 6 for k in range(count))]] = 1.0
    return jnp.asarray(np.outer(is_size, is_size) - np.diag(is_size))


def propagate(
    tuning: OrbitFilterTuning,
    estimate: JointEstimate,
    own: RelativeEstimate,
    peers: Float[Array, "peers 15"],
    gravity_gradient: Matrix,
    burn_covariance: Matrix,
    dt: float,
) -> JointEstimate:
    """Estimate `dt` [s] later with the means already propagated; errors of the peers' views wait for their messages."""
    decay, own_variance = _slow_process(tuning, replace(estimate.own, r_TS_N=own.r_TS_N), dt)
    identity = jnp.eye(3, dtype=burn_covariance.dtype)
    unmodelled = tuning.relative_acceleration_noise**2 * dt * identity
    # A burn moves the servicer away from target and peers alike; half of an unmodelled acceleration is its own.
    same, other = burn_covariance + unmodelled, burn_covariance + 0.5 * unmodelled
    kick, count = dt * gravity_gradient, peers.shape[0]
    starts = [0, *(OWN + PEER * k for k in range(count))]

    def drift(P: Array) -> list[Array]:
        rows = []
        for index, start in enumerate(starts):
            velocity = P[start + 3 : start + 6] + product(kick, P[start : start + 3])
            slow = P[6:OWN] * decay[:, None] if index == 0 else P[start + 6 : start + PEER]
            rows += [P[start : start + 3] + dt * velocity, velocity, slow]
        return rows

    rows = drift(jnp.concatenate(drift(estimate.covariance), axis=0).T)
    for index in range(len(starts)):
        noise = [_noise_columns(same if index == k else other, 6 if k == 0 else 9) for k in range(len(starts))]
        rows[3 * index + 1] = rows[3 * index + 1] + jnp.concatenate(noise, axis=1)
    rows[2] = rows[2] + jnp.pad(jnp.diag(own_variance), ((0, 0), (6, PEER * count)))
    return JointEstimate(own=own, peers=peers, covariance=jnp.concatenate(rows, axis=0))


def _noise_columns(covariance: Matrix, slow: int) -> Float[Array, "3 k"]:
    """Covariance of a velocity with the position, velocity and `slow` errors of a block."""
    return jnp.pad(covariance, ((0, 0), (3, slow)))


def _slow_process(
    tuning: OrbitFilterTuning, own: RelativeEstimate, dt: float | Scalar
) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
    """Decay over `dt` [s] of the errors of size, bearing and centre of a view, and their process variance."""
    errors = shape_errors.shape_errors(
        tuning, outline_correlation.correlation_time(own.outline), own.scale[0], own.r_TS_N
    )
    one = jnp.ones(2, dtype=errors.scale_variance.dtype)
    decay = jnp.concatenate(
        [jnp.exp(-dt / errors.scale_time_constant), one, one * jnp.exp(-dt / errors.center_time_constant)]
    )
    variance = jnp.concatenate([errors.scale_variance, 0.0 * one, errors.center_variance * one])
    walk = jnp.pad(jnp.full(2, errors.bearing_process_variance * dt), (2, 2))
    return decay, variance * (1.0 - decay**2) + walk


def inflate(estimate: JointEstimate, covariance: Float[Array, "12 12"]) -> JointEstimate:
    """Estimate with an added covariance of the servicer's own states."""
    rest = estimate.covariance.shape[0] - OWN
    return replace(estimate, covariance=estimate.covariance + jnp.pad(covariance, ((0, rest), (0, rest))))


def update_own(
    tuning: OrbitFilterTuning, focal_px: Scalar, estimate: JointEstimate, q_KN: Float[Array, "4"], box: BoxMeasurement
) -> JointEstimate:
    """Estimate after the servicer's own box, which has passed its gate."""
    own = own_estimate(estimate)
    rows, _ = relative_orbit_ekf.rows_of_box(tuning, False, focal_px, own, q_KN, box)
    size = estimate.covariance.shape[0]
    drift = jnp.pad(jnp.full(2, box.attitude_variance_change), (8, size - 10))
    jacobian = jnp.pad(rows.jacobian, ((0, 0), (0, size - OWN)))
    HP = product(rows.jacobian, estimate.covariance[:OWN])
    result = kalman_update.update(estimate.covariance, replace(rows, jacobian=jacobian), HP, process_variance=drift)
    return _corrected(estimate, result)


def hear(
    tuning: OrbitFilterTuning,
    baseline: BaselineTuning,
    estimate: JointEstimate,
    peer: int,
    used: Flag,
    interval: Scalar,
    burns: BurnEffect,
    attitude_variance: Scalar,
) -> JointEstimate:
    """Estimate with what time and burns did to a peer since the message before; unchanged unless the message is `used`.

    Args:
        tuning: of the peer
        baseline: belief in differences of GPS positions
        estimate: of this servicer
        peer: its index
        used: () bool
        interval: () between the time stamps [s]
        burns: effect of the peer's burns since the message before, propagated to now
        attitude_variance: () change of the variance of the peer's attitude since then [rad^2]
    """
    start, size = OWN + PEER * peer, estimate.covariance.shape[0]
    before = estimate.peers[peer]
    view = replace(estimate.own, scale=before[6:8], r_TS_N=estimate.own.r_TS_N - before[:3])
    dt = jnp.where(used, interval, 0.0)
    decay, variance = _slow_process(tuning, view, dt)
    gps_decay = jnp.exp(-dt / baseline.error_time_constant)
    factors = jnp.concatenate([decay, jnp.full(3, gps_decay)])
    added = jnp.concatenate([variance, jnp.full(3, baseline.error_sigma**2 * (1.0 - gps_decay**2))])
    added = added + jnp.where(used, jnp.pad(jnp.full(2, attitude_variance), (2, 5)), 0.0)
    all_factors = jnp.concatenate(
        [jnp.ones(start + 6, dtype=dt.dtype), factors, jnp.ones(size - start - PEER, dtype=dt.dtype)]
    )
    block = jnp.concatenate(
        [
            jnp.pad(jnp.where(used, burns.covariance, 0.0), ((0, 0), (0, 9))),
            jnp.pad(jnp.diag(added), ((0, 0), (6, 0))),
        ],
        axis=0,
    )
    rest = size - start - PEER
    covariance = estimate.covariance * all_factors[:, None] * all_factors[None, :]
    covariance = covariance + jnp.pad(block, ((start, rest), (start, rest)))
    state = before * jnp.concatenate([jnp.ones(6, dtype=dt.dtype), factors])
    state = state + jnp.pad(jnp.where(used, burns.change, 0.0), (0, 9))
    peers = jnp.concatenate([estimate.peers[:peer], state[None], estimate.peers[peer + 1 :]])
    return replace(estimate, peers=peers, covariance=covariance)


def update_baselines(
    baseline: BaselineTuning,
    estimate: JointEstimate,
    used: Bool[Array, " peers"],
    measured: Float[Array, "peers 3"],
    own_burns: Float[Array, "6"],
    back: Float[Array, "6 6"],
) -> JointEstimate:
    """Estimate after differences of GPS positions, those of the peers less the own one at the time stamp.

    `own_burns` is the effect of the own burns since the time stamp, propagated to now, `back` the state transition
    from now to the time stamp. The noise of the own position is in all differences: from each the mean of those before
    it is taken, which leaves independent noises.
    """
    P, peers = estimate.covariance, estimate.peers
    count, size = peers.shape[0], P.shape[0]
    residuals, jacobians, products, variances, weights = [], [], [], [], []
    before = jnp.zeros((), dtype=P.dtype)
    sums = jnp.zeros(3, dtype=P.dtype), jnp.zeros((3, size), dtype=P.dtype), jnp.zeros((3, size), dtype=P.dtype)
    for k in range(count):
        start, weight = OWN + PEER * k, jnp.where(used[k], 1.0, 0.0).astype(P.dtype)
        predicted = apply(back[:3], peers[k, :6] + own_burns) + peers[k, 12:15]
        H = jnp.concatenate([back[:3], jnp.zeros((3, 6), dtype=P.dtype), jnp.eye(3, dtype=P.dtype)], axis=1)
        row = (
            measured[k] - predicted,
            jnp.pad(H, ((0, 0), (start, size - start - PEER))),
            product(back[:3], P[start : start + 6]) + P[start + 12 : start + 15],
        )
        share = 1.0 / (before + 1.0)
        residual, jacobian, HP = (each - share * total for each, total in zip(row, sums, strict=True))
        residuals.append(residual)
        jacobians.append(jacobian)
        products.append(HP)
        variances.append(jnp.full(3, 0.5 * baseline.noise**2 * (1.0 + share)))
        weights.append(jnp.full(3, weight))
        sums = tuple(total + weight * each for each, total in zip(row, sums, strict=True))
        before = before + weight
    rows = MeasurementRows(
        residual=jnp.concatenate(residuals),
        jacobian=jnp.concatenate(jacobians),
        variance=jnp.concatenate(variances),
        weight=jnp.concatenate(weights),
    )
    return _corrected(estimate, kalman_update.update(P, rows, jnp.concatenate(products)))


def update_peer_box(
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    estimate: JointEstimate,
    peer: int,
    q_KN: Float[Array, "4"],
    box: BoxMeasurement,
    back: Float[Array, "6 6"],
) -> tuple[JointEstimate, Flag]:
    """Estimate after a box of a peer that is as this filter expects it, and whether it was.

    `tuning` and `focal_px` are the peer's, `back` is the state transition from now to the time stamp.
    """
    P, start = estimate.covariance, OWN + PEER * peer
    size = P.shape[0]
    view, view_rows = _view(estimate, peer, back)
    rows, accepted = relative_orbit_ekf.rows_of_box(tuning, True, focal_px, view, q_KN, box)
    motion = product(rows.jacobian[:, :3], back[:3])
    zeros = jnp.zeros((3, 6), dtype=P.dtype)
    own = jnp.concatenate([motion, zeros], axis=1)
    others = jnp.concatenate([-motion, rows.jacobian[:, 6:]], axis=1)
    jacobian = jnp.concatenate([own, jnp.pad(others, ((0, 0), (start - OWN, size - start - OWN)))], axis=1)
    HP = product(rows.jacobian[:, :3], view_rows[:3]) + product(rows.jacobian[:, 6:], view_rows[6:])
    result = kalman_update.update(P, replace(rows, jacobian=jacobian), HP)
    return _corrected(estimate, result), accepted


def _view(
    estimate: JointEstimate, peer: int, back: Float[Array, "6 6"]
) -> tuple[RelativeEstimate, Float[Array, "12 n"]]:
    """The target as a peer saw it at a time stamp, and the covariance of that with the joint state."""
    P, start = estimate.covariance, OWN + PEER * peer
    state = estimate.peers[peer]
    own = jnp.concatenate([estimate.own.r_TS_N, estimate.own.v_TS_N])
    target = apply(back, own - state[:6])
    rows = jnp.concatenate([product(back, P[:6] - P[start : start + 6]), P[start + 6 : start + OWN]], axis=0)
    columns = jnp.concatenate(
        [product(rows[:, :6] - rows[:, start : start + 6], back.T), rows[:, start + 6 : start + OWN]], axis=1
    )
    view = replace(
        estimate.own,
        r_TS_N=target[:3],
        v_TS_N=target[3:],
        scale=state[6:8],
        bearing_bias=state[8:10],
        center_offset=state[10:12],
        covariance=columns,
    )
    return view, rows


def _corrected(estimate: JointEstimate, result: KalmanUpdate) -> JointEstimate:
    """Estimate with the correction of an update."""
    return JointEstimate(
        own=relative_orbit_ekf.corrected(estimate.own, result, estimate.own.outline),
        peers=estimate.peers + result.deviation[OWN:].reshape(estimate.peers.shape),
        covariance=result.covariance,
    )
