"""Extended Kalman filter of the target relative to the servicer, with bounding boxes as measurements.

Its state is that of `relative_filter_state`, its measurement that of `box_measurement`.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update
from rpojax.core.filter_state_layout import StateLayout
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import replace
from rpojax.core.vectors import product
from rpojax.flight.navigation import (
    orbit_covariance,
    outline_correlation,
    relative_filter_state,
    shape_errors,
    target_attitude_ekf,
)
from rpojax.flight.navigation.box_measurement import box_measurement_model, detection_model, outlier_gate
from rpojax.flight.navigation.box_measurement.box_measurement_model import (
    ExpectedBox,
    LinearisedBox,
    PriorBox,
    expected_box,
    linearise_box,
    predicted_at,
    prior_box,
)
from rpojax.flight.navigation.box_measurement.outlier_gate import GateDecision, GateState
from rpojax.flight.navigation.orbit_covariance import OrbitStep
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxView
from rpojax.flight.navigation.outline_correlation import OutlineCorrelation
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.sensor_innovation import SensorInnovation

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


def measurement_rows(
    tuning: OrbitFilterTuning, view: BoxView, estimate: RelativeEstimate, prior: PriorBox, decision: GateDecision
) -> tuple[LinearisedBox, MeasurementRows]:
    """Box at the linearisation point, and its rows for the update."""
    # Linearising at the posterior lets the noise of a box rotate its own Jacobian, which biases the range by decimetres
    # per hour; so only while the prior is much wider than the box, where linearising at the prior would be worse.
    iterated = _iterated_position(tuning, view, estimate, prior.measured)
    linearisation_point = jnp.where(prior.is_wide & ~prior.range_is_wide, iterated, prior.reference)
    slow = estimate.slow
    model = linearise_box(tuning, view, linearisation_point, slow["size"][0], slow["bearing_bias"])
    offset_N = estimate.r_TS_N - linearisation_point
    residual = prior.measured - predicted_at(view, model, slow["bearing_bias"], offset_N)
    size = _size_row(tuning, view, prior, decision, (residual[2], model.variance[2]))
    rows = MeasurementRows(
        residual=jnp.concatenate([residual[:2], size[:1]]),
        jacobian=_jacobian(estimate.layout, model),
        variance=jnp.concatenate([model.variance[:2], size[1:2]]),
        weight=jnp.stack([decision.weight, decision.weight, size[2]]),
    )
    return model, rows


def _size_row(
    tuning: OrbitFilterTuning, view: BoxView, prior: PriorBox, decision: GateDecision, of_box: tuple[Scalar, Scalar]
) -> Vector:
    """Residual, variance and weight of the log-size, from those `of_box`, and from whether there is one."""
    box, focal_px, (residual, variance) = view.box, view.focal_px, of_box
    log_size_px = jnp.log(focal_px) + prior.model.predicted[2] + prior.slow_errors[2]
    half_size = 0.5 * jnp.exp(log_size_px) / focal_px
    in_frame = jnp.all(jnp.abs(prior.model.predicted[:2]) + half_size < box.half_frame_tangent, axis=0)
    looked_for = box.expected & ~box.present & prior.in_front & in_frame & ~prior.is_wide
    whole = ~box.truncated
    found = detection_model.detection_information(
        tuning, log_size_px, prior.variance[2], decision.accepted & whole, looked_for
    )
    # The bearing to a part of the target lies on a half-line, which no linear update of a wide prior can represent: the
    # size of that part keeps the target on it.
    measured = jnp.where(whole | prior.range_is_wide, decision.weight, 0.0)
    variance = outlier_gate.bounded_size_variance(tuning, prior, jnp.where(whole, variance, _PART_SIZE_SIGMA**2))
    precision = measured / variance + found.precision
    known = precision > _LEAST_PRECISION
    safe = jnp.where(known, precision, 1.0)
    return jnp.stack([(measured * residual / variance + found.residual) / safe, 1.0 / safe, jnp.where(known, 1.0, 0.0)])


_PART_SIZE_SIGMA = 0.5
"""Sigma of the log-size of the target by the box of a part of it [-]. A choice: a part is 0.6 to 1.6 of the target."""

_LEAST_PRECISION = 1e-6
"""Precision below which a frame tells nothing of the size: a sigma of 1000 of its log."""


def _jacobian(layout: StateLayout, model: LinearisedBox) -> Float[Array, "3 n"]:
    """Derivative of the box to the state."""
    dtype = model.position_jacobian.dtype
    bearing = jnp.eye(3, 2, dtype=dtype)
    return layout.rows(
        position=model.position_jacobian,
        size=jnp.array([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0]], dtype=dtype),
        bearing_bias=bearing,
        center_offset=model.inverse_depth * bearing,
    )


def jacobian_times_covariance(estimate: RelativeEstimate, model: LinearisedBox) -> Float[Array, "3 n"]:
    """Jacobian times covariance, by the columns of the Jacobian that are not zero."""
    P, layout, d = estimate.covariance, estimate.layout, model.inverse_depth
    position = product(model.position_jacobian, P[layout["position"]])
    bias, center, size = P[layout["bearing_bias"]], P[layout["center_offset"]], P[layout["size"]]
    # Row by row: the update takes them one by one, and XLA need not join them.
    return jnp.stack(
        [
            position[0] + bias[0] + d * center[0],
            position[1] + bias[1] + d * center[1],
            position[2] + size[0] + size[1],
        ]
    )


def _iterated_position(
    tuning: OrbitFilterTuning, view: BoxView, estimate: RelativeEstimate, measured: Vector
) -> Vector:
    """Linearisation point near the posterior: two Gauss-Newton steps of an iterated filter on the bearing.

    A bearing far more certain than the prior must be linearised along the measured direction, or the long axis of the
    updated covariance points the wrong way.
    """
    P, slow_size = estimate.position_covariance, estimate.slow["size"][0]
    point = estimate.r_TS_N
    for _ in range(2):
        model = linearise_box(tuning, view, point, slow_size)
        G = model.position_jacobian[:2]
        residual = measured[:2] - model.predicted[:2] - jnp.sum(G * (estimate.r_TS_N - point)[None, :], axis=1)
        PG = jnp.sum(P[:, None, :] * G[None, :, :], axis=2)
        S = jnp.sum(G[:, :, None] * PG[None, :, :], axis=1)
        noise = (
            model.variance[:2]
            + relative_filter_state.lasting_variance(tuning.bearing_bias_sigma)
            + model.inverse_depth**2 * shape_errors.center_variance(tuning, slow_size, point)
        )
        a, b, c = S[0, 0] + noise[0], S[0, 1], S[1, 1] + noise[1]
        solved = jnp.stack([c * residual[0] - b * residual[1], a * residual[1] - b * residual[0]]) / (a * c - b * b)
        point = estimate.r_TS_N + jnp.sum(PG * solved[None, :], axis=1)
    return point


def predict(tuning: OrbitFilterTuning, moved: RelativeEstimate, step: OrbitStep) -> RelativeEstimate:
    """Estimate after a step, of which position and velocity have `moved` already."""
    decay, slow_process_variance = relative_filter_state.slow_process(
        tuning, moved, moved.r_TS_N, moved.v_TS_N, step.dt
    )
    noisy = step.with_acceleration_noise(tuning.relative_acceleration_noise)
    factors = moved.layout.after("velocity").split(decay)
    slow, covariance, target = moved.slow, moved.covariance, moved.target
    if target is not None:
        target, slow, covariance = target_attitude_ekf.predict(
            target, moved.layout, slow, covariance, step.r_SN_N + moved.r_TS_N, step.dt
        )
    return replace(
        moved,
        slow={name: factors[name] * value for name, value in slow.items()},
        covariance=orbit_covariance.propagate(covariance, noisy, decay, slow_process_variance),
        outline=outline_correlation.elapse(moved.outline, step.dt),
        target=target,
    )


def update(
    tuning: OrbitFilterTuning, gated: bool, estimate: RelativeEstimate, gate: GateState, view: BoxView
) -> tuple[RelativeEstimate, GateState, SensorInnovation, ExpectedBox]:
    """Estimate after a box that passes the gate, state of the gate, diagnostics, and the expected box."""
    prior = prior_box(tuning, view, estimate)
    decision = _decide(tuning, gated, view, gate, prior)
    model, rows = measurement_rows(tuning, view, estimate, prior, decision)
    gate, recover = outlier_gate.update(tuning, view, gate, decision)
    result = kalman_update.update(
        estimate.covariance,
        rows,
        jacobian_times_covariance(estimate, model),
        process_variance=prior.process_variance,
        inflation_variance=recovery_variance(tuning, estimate.layout, estimate.r_TS_N, recover),
    )
    outline = _updated_outline(tuning, view, estimate, decision.accepted)
    after = relative_filter_state.corrected(replace(estimate, outline=outline), result.deviation, result.covariance)
    innovation = SensorInnovation.of_update(result, view.box.present, decision.accepted)
    return after, gate, innovation, expected_box(prior, view.box)


def rows_of_box(
    tuning: OrbitFilterTuning, gated: bool, estimate: RelativeEstimate, view: BoxView
) -> tuple[MeasurementRows, Bool[Array, ""]]:
    """Rows for the update of a larger filter of which `estimate` is a part, and whether the box is used.

    The box has passed a gate before: that of the camera's own computer. With `gated` it must be as the larger filter
    expects it, too. A size that follows from a frame without a box is a row as well.
    """
    prior = prior_box(tuning, view, estimate)
    accepted = view.box.present
    if gated:
        possible = prior.in_front | prior.range_is_wide
        accepted = accepted & possible & outlier_gate.is_inside(tuning, view.box, prior)
    _, rows = measurement_rows(tuning, view, estimate, prior, GateDecision.without_gate(accepted))
    return rows, accepted


def recovery_variance(
    tuning: OrbitFilterTuning, layout: StateLayout, r_TS_N: Vector, recover: Bool[Array, ""]
) -> Float[Array, " n"]:
    """Covariance inflation after too many rejections, so that the filter accepts the target's boxes again."""
    square = jnp.sum(r_TS_N * r_TS_N, axis=0)
    position = jnp.where(recover, tuning.recovery_position_sigma**2 * square, 0.0)
    velocity = jnp.where(recover, tuning.recovery_velocity_sigma**2, 0.0)
    return layout.vector(position=jnp.full(3, position), velocity=jnp.full(3, velocity))


def _decide(tuning: OrbitFilterTuning, gated: bool, view: BoxView, gate: GateState, prior: PriorBox) -> GateDecision:
    """Whether the box is used; without a gate every box is."""
    box = view.box
    if not gated:
        decision = GateDecision.without_gate(box.present)
        return decision if box.weight is None else replace(decision, weight=box.weight)
    possible = (prior.in_front | prior.range_is_wide) & (
        ~box.truncated | box_measurement_model.may_be_truncated(tuning, prior.model, prior.variance, box)
    )
    return outlier_gate.accept(tuning, view, gate, prior, possible)


def _updated_outline(
    tuning: OrbitFilterTuning, view: BoxView, estimate: RelativeEstimate, accepted: Array
) -> OutlineCorrelation:
    """Correlation of the outline after a box; the noise is that of the expected size."""
    box, side_px = view.box, view.focal_px * tuning.target_size / gradient_safe.norm(estimate.r_TS_N)
    noise_variance = _ASPECT_NOISE_FACTOR * (tuning.edge_noise / side_px) ** 2
    return outline_correlation.update(estimate.outline, box.log_aspect, noise_variance, accepted & ~box.truncated)


_ASPECT_NOISE_FACTOR = 4.5
"""Variance of the log aspect ratio over that of an edge in units of the size: 4 for a square, and 2 (w / h + h / w) for
others: 4.47 is the mean over attitudes of the packaged hull."""
