"""Measurements of the joint filter: own boxes, differences of GPS positions, ranges over the link, boxes of peers.

What a message measured at its time stamp is a function of the state now by the state transition `back` from now to the
stamp, None if there is no delay.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import replace
from rpojax.core.vectors import product
from rpojax.flight.cooperation import joint_covariance
from rpojax.flight.cooperation.free_relative_motion import apply
from rpojax.flight.cooperation.joint_covariance import JointCovariance
from rpojax.flight.cooperation.joint_filter import MOTION, OWN_SLOW, JointEstimate, inflate, own_estimate
from rpojax.flight.cooperation.link_settings import BaselineTuning
from rpojax.flight.navigation import outline_correlation, relative_orbit_ekf, shape_errors
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.relative_estimate import RelativeEstimate

Flag = Bool[Array, ""]
Scalar = Float[Array, ""]
Transition = Float[Array, "6 6"] | None

_GPS = slice(3, 6)
"""Slow error of the GPS difference among a peer's slow errors."""
_LEAST_INTERVAL = 1e-2
"""Shortest time between two boxes of a peer, of which the first has none [s]."""


def update_own(
    tuning: OrbitFilterTuning, focal_px: Scalar, estimate: JointEstimate, q_KN: Float[Array, "4"], box: BoxMeasurement
) -> JointEstimate:
    """Estimate after the servicer's own box, which has passed its gate."""
    rows, _ = relative_orbit_ekf.rows_of_box(tuning, False, focal_px, own_estimate(estimate), q_KN, box)
    estimate = inflate(estimate, jnp.pad(jnp.full(2, box.attitude_variance_change), (8, 2)))
    P, J = estimate.covariance, rows.jacobian
    jacobian = _placed([(0, J[:, :3]), (2 * P.xx.shape[0], J[:, 6:])], _size(P))
    # Size errors are in the third row alone, those of bearing and centre in the others.
    slow = P.slow_rows(0, OWN_SLOW)
    bearing = slow[2:4] + J[0, 10] * slow[4:6]
    HP = product(J[:, :3], P.position_rows[:3]) + jnp.concatenate([bearing, slow[:1] + slow[1:2]], axis=0)
    return _corrected(estimate, replace(rows, jacobian=jacobian), HP)


def update_baselines(
    baseline: BaselineTuning,
    estimate: JointEstimate,
    used: Bool[Array, " peers"],
    measured: Float[Array, "peers 3"],
    own_burns: Float[Array, "6"],
    back: Transition,
) -> JointEstimate:
    """Estimate after differences of GPS positions, those of the peers less the own one at the time stamp.

    `own_burns` is the effect of the own burns since the time stamp, propagated to now. The noise of the own position is
    in all differences: from each the mean of those before it is taken, which leaves independent noises.
    """
    P, size = estimate.covariance, _size(estimate.covariance)
    then = _rows_then(P, back)
    residuals, jacobians, products, variances, weights = [], [], [], [], []
    before = jnp.zeros((), dtype=P.xx.dtype)
    sums = jnp.zeros(3, dtype=P.xx.dtype), jnp.zeros((3, size), dtype=P.xx.dtype), jnp.zeros((3, size))
    for k in range(estimate.peers.shape[0]):
        slow, weight = estimate.slow_start(k) + _GPS.start, jnp.where(used[k], 1.0, 0.0).astype(P.xx.dtype)
        predicted = _baseline_then(estimate, k, own_burns, back) + estimate.peers[k, 9:12]
        identity = jnp.eye(3, dtype=P.xx.dtype)
        parts = [*_parts_then(identity, 1 + k, P, back), (2 * P.xx.shape[0] + slow, identity)]
        row = (
            measured[k] - predicted,
            _placed(parts, size),
            then[3 + 3 * k : 6 + 3 * k] + P.slow_rows(slow, 3),
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
    return _corrected(estimate, rows, jnp.concatenate(products))


def update_ranges(
    baseline: BaselineTuning,
    estimate: JointEstimate,
    used: Bool[Array, " peers"],
    measured: Float[Array, " peers"],
    own_burns: Float[Array, "6"],
    back: Transition,
) -> JointEstimate:
    """Estimate after ranges [m] to the peers over the link at the time stamp, each with a constant bias.

    The range of an uncertain baseline is longer than that of its mean by `t / 2 r` and has the variance `t^2 / 2 r^2`
    at most besides, `t` the variance across it: the second order of the range (Jazwinski, 1970).
    """
    P, size = estimate.covariance, _size(estimate.covariance)
    then = _rows_then(P, back)
    residuals, jacobians, products, variances = [], [], [], []
    for k in range(estimate.peers.shape[0]):
        b = _baseline_then(estimate, k, own_burns, back)
        distance, slow = gradient_safe.norm(b), estimate.slow_start(k) + _GPS.stop
        u = b / distance
        rows_k = then[3 + 3 * k : 6 + 3 * k]
        position = _columns_then(rows_k, 1 + k, P, back)
        trace = position[0, 0] + position[1, 1] + position[2, 2]
        across = jnp.maximum(trace - jnp.sum(u * apply(position, u), axis=0), 0.0)
        residuals.append(measured[k] - distance - 0.5 * across / distance - estimate.peers[k, 12])
        one = jnp.ones((1, 1), dtype=u.dtype)
        parts = [*_parts_then(u[None], 1 + k, P, back), (2 * P.xx.shape[0] + slow, one)]
        jacobians.append(_placed(parts, size))
        products.append(product(u[None], rows_k) + P.slow_rows(slow, 1))
        variances.append(baseline.range_noise**2 + 0.5 * (across / distance) ** 2)
    rows = MeasurementRows(
        residual=jnp.stack(residuals),
        jacobian=jnp.concatenate(jacobians),
        variance=jnp.stack(variances),
        weight=jnp.where(used, 1.0, 0.0).astype(P.xx.dtype),
    )
    return _corrected(estimate, rows, jnp.concatenate(products))


def update_peer_box(
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    estimate: JointEstimate,
    peer: int,
    q_KN: Float[Array, "4"],
    box: BoxMeasurement,
    interval: Scalar,
    back: Transition,
) -> tuple[JointEstimate, Flag]:
    """Estimate after a box of a peer that is as this filter expects it, and whether it was.

    `tuning` and `focal_px` are the peer's, `interval` [s] is the time since its message before. The errors of the
    peer's box that change as the target tumbles count as white noise of the same spectral density at low frequencies:
    the variance of a Gauss-Markov process times (1 + a) / (1 - a), `a` its correlation over the interval.
    """
    P, slow = estimate.covariance, estimate.slow_start(peer)
    errors = _fast_errors(tuning, estimate, peer)
    view, position_rows = _view(estimate, peer, errors, back)
    rows, accepted = relative_orbit_ekf.rows_of_box(tuning, True, focal_px, view, q_KN, box)
    J = rows.jacobian
    interval = jnp.maximum(jnp.maximum(interval, box.interval), _LEAST_INTERVAL)
    size_noise = _white(errors.scale_variance[1], interval, errors.scale_time_constant[1])
    center_noise = J[0, 10] ** 2 * _white(errors.center_variance, interval, errors.center_time_constant)
    variance = rows.variance + jnp.stack([center_noise, center_noise, size_noise])
    of_bias = jnp.concatenate([J[:, 6:7], J[:, 8:10]], axis=1)
    parts = [
        *_parts_then(J[:, :3], 0, P, back),
        *_parts_then(-J[:, :3], 1 + peer, P, back),
        (2 * P.xx.shape[0] + slow, of_bias),
    ]
    HP = product(J[:, :3], position_rows) + product(of_bias, P.slow_rows(slow, 3))
    return _corrected(estimate, replace(rows, jacobian=_placed(parts, _size(P)), variance=variance), HP), accepted


def _fast_errors(tuning: OrbitFilterTuning, estimate: JointEstimate, peer: int) -> shape_errors.ShapeErrors:
    """Errors of a peer's boxes that come from the target's shape."""
    state = estimate.peers[peer]
    time = outline_correlation.correlation_time(estimate.own.outline)
    r, v = estimate.own.r_TS_N - state[:3], estimate.own.v_TS_N - state[3:6]
    return shape_errors.shape_errors(tuning, time, state[MOTION], r, v)


def _white(variance: Scalar, interval: Scalar, time_constant: Scalar) -> Scalar:
    """Variance of white noise per interval with the effect of a Gauss-Markov process in the long run."""
    a = jnp.exp(-interval / time_constant)
    return variance * (1.0 + a) / (1.0 - a)


def _view(
    estimate: JointEstimate, peer: int, errors: shape_errors.ShapeErrors, back: Transition
) -> tuple[RelativeEstimate, Float[Array, "3 n"]]:
    """The target as a peer saw it at a time stamp, and the covariance of that position with the joint state."""
    P, start = estimate.covariance, estimate.slow_start(peer)
    state = estimate.peers[peer]
    target = jnp.concatenate([estimate.own.r_TS_N, estimate.own.v_TS_N]) - state[:MOTION]
    target = target if back is None else apply(back, target)
    then = _rows_then(P, back)
    rows = then[:3] - then[3 + 3 * peer : 6 + 3 * peer]
    position = _columns_then(rows, 0, P, back) - _columns_then(rows, 1 + peer, P, back)
    first = 2 * P.xx.shape[0] + start
    mixed, slow = rows[:, first : first + 3], P.ss[start : start + 3, start : start + 3]
    fast, center = errors.scale_variance[1], errors.center_variance
    view = replace(
        estimate.own,
        r_TS_N=target[:3],
        v_TS_N=target[3:],
        scale=jnp.pad(state[6:7], (0, 1)),
        bearing_bias=state[7:9],
        center_offset=jnp.zeros_like(state[7:9]),
        covariance=_view_covariance(position, mixed, slow, fast, center),
    )
    return view, rows


def _view_covariance(position: Array, mixed: Array, slow: Array, fast: Scalar, center: Scalar) -> Float[Array, "12 12"]:
    """Covariance of a view from that of position (3, 3), of it with slow errors (3, 3), of these, and fast errors.

    That of the velocity is left out: a box does not depend on it.
    """
    gap = jnp.zeros((3, 3), dtype=position.dtype)
    column, pair = jnp.zeros((3, 1), dtype=position.dtype), jnp.zeros((3, 2), dtype=position.dtype)

    def row(of_position: Array, of_slow: Array) -> Array:
        return jnp.concatenate([of_position, gap, of_slow[:, :1], column, of_slow[:, 1:], pair], axis=1)

    errors = row(mixed.T, slow)
    rest = jnp.diag(jnp.stack([jnp.zeros_like(fast)] * 7 + [fast] + [jnp.zeros_like(fast)] * 2 + [center] * 2))
    rows = [
        row(position, mixed),
        jnp.zeros((3, 12), dtype=position.dtype),
        errors[:1],
        jnp.zeros((1, 12), dtype=position.dtype),
        errors[1:],
        jnp.zeros((2, 12), dtype=position.dtype),
    ]
    return jnp.concatenate(rows, axis=0) + rest


def _size(P: JointCovariance) -> int:
    return 2 * P.xx.shape[0] + P.ss.shape[0]


def _placed(parts: list[tuple[int, Array]], size: int) -> Float[Array, "m n"]:
    """Rows with some columns, each from its first one on, and zeros elsewhere."""
    pieces, end = [], 0
    for first, block in sorted(parts, key=lambda part: part[0]):
        if first > end:
            pieces.append(jnp.zeros((block.shape[0], first - end), dtype=block.dtype))
        pieces.append(block)
        end = first + block.shape[1]
    if end < size:
        pieces.append(jnp.zeros((parts[0][1].shape[0], size - end), dtype=parts[0][1].dtype))
    return jnp.concatenate(pieces, axis=1)


def _parts_then(J: Float[Array, "m 3"], body: int, P: JointCovariance, back: Transition) -> list[tuple[int, Array]]:
    """Parts of rows that depend by `J` on the position of a body at the time stamp."""
    if back is None:
        return [(3 * body, J)]
    return [(3 * body, product(J, back[:3, :3])), (P.xx.shape[0] + 3 * body, product(J, back[:3, 3:]))]


def _rows_then(P: JointCovariance, back: Transition) -> Float[Array, "x n"]:
    """Covariance of the positions of all bodies at the time stamp with the state."""
    if back is None:
        return P.position_rows
    return joint_covariance.of_each_body(back[:3, :3], P.position_rows) + joint_covariance.of_each_body(
        back[:3, 3:], P.velocity_rows
    )


def _columns_then(rows: Float[Array, "3 n"], body: int, P: JointCovariance, back: Transition) -> Float[Array, "3 3"]:
    """Covariance of what has these rows with the position of a body at the time stamp."""
    x, v = rows[:, 3 * body : 3 * body + 3], P.xx.shape[0] + 3 * body
    return x if back is None else product(x, back[:3, :3].T) + product(rows[:, v : v + 3], back[:3, 3:].T)


def _baseline_then(
    estimate: JointEstimate, peer: int, own_burns: Float[Array, "6"], back: Transition
) -> Float[Array, "3"]:
    """Position of a peer at the time stamp."""
    motion = estimate.peers[peer, :MOTION]
    return motion[:3] if back is None else apply(back[:3], motion + own_burns)


def _corrected(estimate: JointEstimate, rows: MeasurementRows, HP: Float[Array, "m n"]) -> JointEstimate:
    """Estimate after measurements, with Jacobian times covariance."""
    gains = kalman_update.sequential_gains(rows, lambda index: HP[index])
    x, s, d = estimate.covariance.xx.shape[0], 2 * estimate.covariance.xx.shape[0], gains.deviation
    own, peers = estimate.own, []
    for k in range(estimate.peers.shape[0]):
        place, slow = 3 + 3 * k, s + estimate.slow_start(k)
        columns = estimate.peers.shape[1] - MOTION
        peers.append(jnp.concatenate([d[place : place + 3], d[x + place : x + place + 3], d[slow : slow + columns]]))
    own = replace(
        own,
        r_TS_N=own.r_TS_N + d[:3],
        v_TS_N=own.v_TS_N + d[x : x + 3],
        scale=own.scale + d[s : s + 2],
        bearing_bias=own.bearing_bias + d[s + 2 : s + 4],
        center_offset=own.center_offset + d[s + 4 : s + 6],
    )
    covariance = joint_covariance.reduced(estimate.covariance, gains)
    return JointEstimate(own=own, peers=estimate.peers + jnp.stack(peers), covariance=covariance)
