"""Measurements of the joint filter: own boxes, differences of GPS positions, ranges over the link, boxes of peers.

What a message measured at its time stamp is a function of the state now by the state transition `to_stamp` from now
to the stamp, None if there is no delay.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update
from rpojax.core.filter_state_layout import MOTION, StateLayout
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import replace
from rpojax.core.vectors import apply, product
from rpojax.flight.cooperation import joint_covariance
from rpojax.flight.cooperation.joint_covariance import JointCovariance
from rpojax.flight.cooperation.joint_filter import JointEstimate, inflate, own_estimate
from rpojax.flight.cooperation.received_messages import OwnThen, ReceivedMessages
from rpojax.flight.cooperation.team_settings import BaselineTuning, ServicerTuning
from rpojax.flight.navigation import (
    believed_sensor,
    outline_correlation,
    relative_filter_state,
    relative_orbit_ekf,
    shape_errors,
)
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, box_view
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.shape_errors import ShapeErrors

Scalar = Float[Array, ""]
Transition = Float[Array, "6 6"] | None

_LEAST_INTERVAL = 1e-2
"""Shortest time between two boxes of a peer, of which the first has none [s]: below that of any camera, and with 25 s
of correlation the noise of that box is 70 times as large, so that it hardly counts."""


def update_own(
    tuning: ServicerTuning, estimate: JointEstimate, q_KN: Float[Array, "4"], box: BoxMeasurement
) -> JointEstimate:
    """Estimate after the servicer's own box, which has passed its gate."""
    view = box_view(box, tuning.focal_px, q_KN)
    rows, _ = relative_orbit_ekf.rows_of_box(tuning.filter, False, own_estimate(estimate), view)
    own, layout = estimate.own.layout, estimate.own_slow
    estimate = inflate(estimate, own.vector(bearing_bias=jnp.full(2, box.attitude_variance_change)))
    P, J = estimate.covariance, rows.jacobian
    by_position = J[:, own["position"]]
    jacobian = _placed([(0, by_position), (2 * P.xx.shape[0], J[:, MOTION.size :])], _size(P))
    # Size errors are in the third row alone, those of bearing and centre in the others.
    bias, center, (slow, fast) = (P.slow_rows(layout[name]) for name in ("bearing_bias", "center_offset", "size"))
    bearing = bias + J[0, own["center_offset"].start] * center
    HP = product(by_position, P.position_rows[:3]) + jnp.concatenate([bearing, (slow + fast)[None]], axis=0)
    return _corrected(estimate, replace(rows, jacobian=jacobian), HP)


def update_by_rows(estimate: JointEstimate, rows: MeasurementRows) -> JointEstimate:
    """Estimate after measurements of the servicer's own state, with rows as of a state of zero."""
    P, own, slow = estimate.covariance, estimate.own.layout, estimate.own_slow.size
    rows = believed_sensor.at_estimate(rows, estimate.own)
    by_position, by_velocity = rows.jacobian[:, own["position"]], rows.jacobian[:, own["velocity"]]
    by_slow, x = rows.jacobian[:, MOTION.size :], P.xx.shape[0]
    HP = product(by_position, P.position_rows[:3]) + product(by_velocity, P.velocity_rows[:3])
    HP = HP + product(by_slow, P.slow_rows(slice(0, slow)))
    jacobian = _placed([(0, by_position), (x, by_velocity), (2 * x, by_slow)], _size(P))
    return _corrected(estimate, replace(rows, jacobian=jacobian), HP)


def update_baselines(baseline: BaselineTuning, estimate: JointEstimate, received: ReceivedMessages) -> JointEstimate:
    """Estimate after differences of GPS positions, those of the peers less the own one at the time stamp.

    The noise of the own position is in all differences: from each the mean of those before it is taken, which leaves
    independent noises.
    """
    P, size, to_stamp = estimate.covariance, _size(estimate.covariance), received.own.to_stamp
    then = _rows_then(P, to_stamp)
    residuals, jacobians, products, variances, weights = [], [], [], [], []
    before = jnp.zeros((), dtype=P.xx.dtype)
    sums = jnp.zeros(3, dtype=P.xx.dtype), jnp.zeros((3, size), dtype=P.xx.dtype), jnp.zeros((3, size))
    for k in range(estimate.peers.shape[0]):
        slow = estimate.slow_places(k, "gps_difference")
        weight = jnp.where(received.measured[k], 1.0, 0.0).astype(P.xx.dtype)
        error = estimate.peers[k, estimate.peer_layout["gps_difference"]]
        predicted = _baseline_then(estimate, k, received.own) + error
        identity = jnp.eye(3, dtype=P.xx.dtype)
        parts = [*_parts_then(identity, 1 + k, P, to_stamp), (2 * P.xx.shape[0] + slow.start, identity)]
        row = (
            received.baseline[k] - predicted,
            _placed(parts, size),
            then[3 + 3 * k : 6 + 3 * k] + P.slow_rows(slow),
        )
        share = 1.0 / (before + 1.0)
        residual, jacobian, HP = (term - share * total for term, total in zip(row, sums, strict=True))
        residuals.append(residual)
        jacobians.append(jacobian)
        products.append(HP)
        variances.append(jnp.full(3, 0.5 * baseline.noise**2 * (1.0 + share)))
        weights.append(jnp.full(3, weight))
        sums = tuple(total + weight * term for term, total in zip(row, sums, strict=True))
        before = before + weight
    rows = MeasurementRows(
        residual=jnp.concatenate(residuals),
        jacobian=jnp.concatenate(jacobians),
        variance=jnp.concatenate(variances),
        weight=jnp.concatenate(weights),
    )
    return _corrected(estimate, rows, jnp.concatenate(products))


def update_ranges(baseline: BaselineTuning, estimate: JointEstimate, received: ReceivedMessages) -> JointEstimate:
    """Estimate after ranges [m] to the peers over the link at the time stamp, each with a constant bias.

    The range of an uncertain baseline is longer than that of its mean by `t / 2 r` and has the variance `t^2 / 2 r^2`
    at most besides, `t` the variance across it: the second order of the range (Jazwinski, 1970).
    """
    assert received.ranges is not None
    P, size, to_stamp = estimate.covariance, _size(estimate.covariance), received.own.to_stamp
    then = _rows_then(P, to_stamp)
    residuals, jacobians, products, variances = [], [], [], []
    for k in range(estimate.peers.shape[0]):
        b = _baseline_then(estimate, k, received.own)
        distance, slow = gradient_safe.norm(b), estimate.slow_places(k, "range_bias")
        u = b / distance
        rows_k = then[3 + 3 * k : 6 + 3 * k]
        position = _columns_then(rows_k, 1 + k, P, to_stamp)
        trace = position[0, 0] + position[1, 1] + position[2, 2]
        across = jnp.maximum(trace - jnp.sum(u * apply(position, u), axis=0), 0.0)
        bias = estimate.peers[k, estimate.peer_layout["range_bias"].start]
        residuals.append(received.ranges[k] - distance - 0.5 * across / distance - bias)
        of_bias = jnp.ones((1, 1), dtype=u.dtype)
        parts = [*_parts_then(u[None], 1 + k, P, to_stamp), (2 * P.xx.shape[0] + slow.start, of_bias)]
        jacobians.append(_placed(parts, size))
        products.append(product(u[None], rows_k) + P.slow_rows(slow))
        variances.append(baseline.range_noise**2 + 0.5 * (across / distance) ** 2)
    rows = MeasurementRows(
        residual=jnp.stack(residuals),
        jacobian=jnp.concatenate(jacobians),
        variance=jnp.stack(variances),
        weight=jnp.where(received.used, 1.0, 0.0).astype(P.xx.dtype),
    )
    return _corrected(estimate, rows, jnp.concatenate(products))


def update_peer_box(
    estimate: JointEstimate, peer: int, received: ReceivedMessages
) -> tuple[JointEstimate, Bool[Array, ""]]:
    """Estimate after the box that is received of a peer if it is as this filter expects it, and whether it was.

    The errors of the peer's box that change as the target tumbles count as white noise of the same spectral density at
    low frequencies: the variance of a Gauss-Markov process times (1 + a) / (1 - a), `a` its correlation over the
    interval since the message before.
    """
    P, slow, own = estimate.covariance, estimate.slow_places(peer, "size", "bearing_bias"), estimate.own.layout
    sent, used, tuning, to_stamp = received.messages, received.used, received.tuning, received.own.to_stamp
    assert sent.box is not None
    box = replace(sent.box, present=sent.box.present & used, expected=sent.box.expected & used)
    errors = _fast_errors(tuning.filter, estimate, peer)
    view, position_rows = _view(estimate, peer, errors, to_stamp)
    seen = box_view(box, tuning.focal_px, sent.q_KN)
    rows, accepted = relative_orbit_ekf.rows_of_box(tuning.filter, True, view, seen)
    J = rows.jacobian
    by_position = J[:, own["position"]]
    interval = jnp.maximum(jnp.maximum(received.interval, box.interval), _LEAST_INTERVAL)
    size_noise = _white(errors.scale_variance[1], interval, errors.scale_time_constant[1])
    center_noise = J[0, own["center_offset"].start] ** 2 * _white(
        errors.center_variance, interval, errors.center_time_constant
    )
    variance = rows.variance + jnp.stack([center_noise, center_noise, size_noise])
    of_bias = jnp.concatenate([J[:, own["size"]][:, :1], J[:, own["bearing_bias"]]], axis=1)
    parts = [
        *_parts_then(by_position, 0, P, to_stamp),
        *_parts_then(-by_position, 1 + peer, P, to_stamp),
        (2 * P.xx.shape[0] + slow.start, of_bias),
    ]
    HP = product(by_position, position_rows) + product(of_bias, P.slow_rows(slow))
    return _corrected(estimate, replace(rows, jacobian=_placed(parts, _size(P)), variance=variance), HP), accepted


def _fast_errors(tuning: OrbitFilterTuning, estimate: JointEstimate, peer: int) -> ShapeErrors:
    """Errors of a peer's boxes that come from the target's shape."""
    state = estimate.peer_layout.split(estimate.peers[peer])
    time = outline_correlation.correlation_time(estimate.own.outline)
    r, v = estimate.own.r_TS_N - state["position"], estimate.own.v_TS_N - state["velocity"]
    return shape_errors.shape_errors(tuning, time, state["size"][0], r, v)


def _white(variance: Scalar, interval: Scalar, time_constant: Scalar) -> Scalar:
    """Variance of white noise per interval with the effect of a Gauss-Markov process in the long run."""
    a = jnp.exp(-interval / time_constant)
    return variance * (1.0 + a) / (1.0 - a)


def _view(
    estimate: JointEstimate, peer: int, errors: ShapeErrors, to_stamp: Transition
) -> tuple[RelativeEstimate, Float[Array, "3 n"]]:
    """The target as a peer saw it at a time stamp, and the covariance of that position with the joint state."""
    P, own, place = estimate.covariance, estimate.own, estimate.slow_places(peer, "size", "bearing_bias")
    state = estimate.peer_layout.split(estimate.peers[peer])
    target = MOTION.vector(position=own.r_TS_N - state["position"], velocity=own.v_TS_N - state["velocity"])
    target = MOTION.split(target if to_stamp is None else apply(to_stamp, target))
    then = _rows_then(P, to_stamp)
    rows = then[:3] - then[3 + 3 * peer : 6 + 3 * peer]
    position = _columns_then(rows, 0, P, to_stamp) - _columns_then(rows, 1 + peer, P, to_stamp)
    first = 2 * P.xx.shape[0]
    mixed, slow = rows[:, first + place.start : first + place.stop], P.ss[place, place]
    shown = {"size": jnp.pad(state["size"], (0, 1)), "bearing_bias": state["bearing_bias"]}
    view = replace(
        own,
        r_TS_N=target["position"],
        v_TS_N=target["velocity"],
        slow={name: shown.get(name, jnp.zeros_like(value)) for name, value in own.slow.items()},
        covariance=_view_covariance(own.layout, position, mixed, slow, errors),
    )
    return view, rows


def _view_covariance(
    layout: StateLayout, position: Array, mixed: Array, slow: Array, fast_errors: ShapeErrors
) -> Float[Array, "n n"]:
    """Covariance of a view from that of position (3, 3), of it with slow errors (3, 3), of these, and fast errors.

    That of the velocity is left out: a box does not depend on it.
    """

    def rows(of_position: Array, of_slow: Array) -> Array:
        size = jnp.pad(of_slow[:, :1], ((0, 0), (0, 1)))
        return layout.rows(position=of_position, size=size, bearing_bias=of_slow[:, 1:])

    errors = rows(mixed.T, slow)
    shown = {
        "position": rows(position, mixed),
        "size": jnp.pad(errors[:1], ((0, 1), (0, 0))),
        "bearing_bias": errors[1:],
    }
    blocks = [shown.get(name, jnp.zeros((size, layout.size), dtype=position.dtype)) for name, size in layout.blocks]
    fast, center = fast_errors.scale_variance[1], fast_errors.center_variance
    fast_variance = layout.vector(size=jnp.stack([jnp.zeros_like(fast), fast]), center_offset=jnp.full(2, center))
    return jnp.concatenate(blocks, axis=0) + jnp.diag(fast_variance)


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


def _parts_then(J: Float[Array, "m 3"], body: int, P: JointCovariance, to_stamp: Transition) -> list[tuple[int, Array]]:
    """Parts of rows that depend by `J` on the position of a body at the time stamp."""
    if to_stamp is None:
        return [(3 * body, J)]
    return [(3 * body, product(J, to_stamp[:3, :3])), (P.xx.shape[0] + 3 * body, product(J, to_stamp[:3, 3:]))]


def _rows_then(P: JointCovariance, to_stamp: Transition) -> Float[Array, "x n"]:
    """Covariance of the positions of all bodies at the time stamp with the state."""
    if to_stamp is None:
        return P.position_rows
    return joint_covariance.of_each_body(to_stamp[:3, :3], P.position_rows) + joint_covariance.of_each_body(
        to_stamp[:3, 3:], P.velocity_rows
    )


def _columns_then(
    rows: Float[Array, "3 n"], body: int, P: JointCovariance, to_stamp: Transition
) -> Float[Array, "3 3"]:
    """Covariance of what has these rows with the position of a body at the time stamp."""
    x, v = rows[:, 3 * body : 3 * body + 3], P.xx.shape[0] + 3 * body
    return x if to_stamp is None else product(x, to_stamp[:3, :3].T) + product(rows[:, v : v + 3], to_stamp[:3, 3:].T)


def _baseline_then(estimate: JointEstimate, peer: int, own: OwnThen) -> Float[Array, "3"]:
    """Position of a peer at the time stamp."""
    motion, place = estimate.peers[peer, : MOTION.size], MOTION["position"]
    return motion[place] if own.to_stamp is None else apply(own.to_stamp[place], motion + own.burns)


def _corrected(estimate: JointEstimate, rows: MeasurementRows, HP: Float[Array, "m n"]) -> JointEstimate:
    """Estimate after measurements, with Jacobian times covariance."""
    gains = kalman_update.sequential_gains(rows, lambda index: HP[index])
    x, d, own_size = estimate.covariance.xx.shape[0], gains.deviation, estimate.own_slow.size
    slow, columns = d[2 * x :], estimate.peers.shape[1] - MOTION.size

    def of_body(body: int, first: int, count: int) -> Array:
        return jnp.concatenate(
            [d[3 * body : 3 * body + 3], d[x:][3 * body : 3 * body + 3], slow[first : first + count]]
        )

    count = estimate.peers.shape[0]
    peers = [of_body(1 + k, own_size + k * columns, columns) for k in range(count)]
    own = relative_filter_state.corrected(estimate.own, of_body(0, 0, own_size), estimate.own.covariance)
    covariance = joint_covariance.reduced(estimate.covariance, gains)
    return JointEstimate(own=own, peers=estimate.peers + jnp.stack(peers), covariance=covariance)
