"""Extended Kalman filter of the target relative to the servicer, with bounding boxes as measurements.

State (12): position and velocity of the target from the servicer in N; log of the apparent size over its expected
value, in a slow and a fast part (2); bearing bias (2); offset of the box centre from the centre of mass, which wanders
as the target tumbles (2).
"""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update, quaternion
from rpojax.core.kalman_update import KalmanUpdate, MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits import two_body_gravity
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import apply, product
from rpojax.flight.navigation import (
    box_measurement_model,
    box_position,
    detection_model,
    orbit_covariance,
    outlier_gate,
    outline_correlation,
    shape_errors,
)
from rpojax.flight.navigation.box_measurement_model import LinearisedBox, linearise_box
from rpojax.flight.navigation.burn_errors import burn_scale
from rpojax.flight.navigation.burn_errors.burn_scale import BurnScale
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.outlier_gate import GateDecision, GateState
from rpojax.flight.navigation.outline_correlation import OutlineCorrelation

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Matrix = Float[Array, "3 3"]


@pytree
class RelativeEstimate:
    """Mean and covariance of the relative state.

    Attributes:
        r_TS_N: (3,) target from servicer [m]
        v_TS_N: (3,) its inertial derivative [m/s]
        scale: (2,) log-size error, slow and fast part [-]
        bearing_bias: (2,) tangents in the camera [rad]
        center_offset: (2,) of the box from the centre of mass, image right and down [m]
        covariance: (12, 12) in this order
        outline: how fast the outline changes, by which the errors of size and centre lose their correlation
        burn_scale: lasting error of the burns' magnitude
    """

    r_TS_N: Array
    v_TS_N: Array
    scale: Array
    bearing_bias: Array
    center_offset: Array
    covariance: Array
    outline: OutlineCorrelation
    burn_scale: BurnScale


def initial_sigma(tuning: OrbitFilterTuning) -> Float[Array, "6"]:
    """1-sigma of position and velocity at hand-over."""
    return jnp.concatenate(
        [
            jnp.full(3, tuning.initial_relative_position_sigma),
            jnp.full(3, tuning.initial_relative_velocity_sigma),
        ]
    )


def initial(tuning: OrbitFilterTuning, r_TS_N: Vector, v_TS_N: Vector) -> RelativeEstimate:
    """Estimate at hand-over with position [m] and velocity [m/s] as means."""
    return RelativeEstimate(
        r_TS_N=r_TS_N,
        v_TS_N=v_TS_N,
        scale=jnp.zeros_like(tuning.scale_sigma),
        bearing_bias=jnp.zeros(2, dtype=r_TS_N.dtype),
        center_offset=jnp.zeros(2, dtype=r_TS_N.dtype),
        covariance=jnp.diag(
            jnp.concatenate(
                [
                    initial_sigma(tuning) ** 2,
                    shape_errors.scale_variance(tuning),
                    jnp.full(2, tuning.bearing_bias_sigma**2),
                    jnp.full(2, shape_errors.center_variance(tuning, jnp.zeros_like(tuning.target_size), r_TS_N)),
                ]
            )
        ),
        outline=outline_correlation.initial(),
        burn_scale=burn_scale.initial(tuning),
    )


def predict(
    tuning: OrbitFilterTuning,
    estimate: RelativeEstimate,
    r_TS_N: Vector,
    v_TS_N: Vector,
    r_SN_N: Vector,
    burn_covariance: Matrix,
    dt: float,
    delta_v_N: Vector | None = None,
) -> RelativeEstimate:
    """Estimate `dt` [s] later with its mean already propagated; `r_SN_N` [m] is the servicer's position before.

    `burn_covariance` is that of the new errors of a burn of `delta_v_N` [m/s], whose magnitude has the lasting error,
    too; without it lasting errors are part of `burn_covariance`.
    """
    errors = shape_errors.shape_errors(
        tuning, outline_correlation.correlation_time(estimate.outline), estimate.scale[0], r_TS_N, v_TS_N
    )
    scale_decay = jnp.exp(-dt / errors.scale_time_constant)
    one = jnp.ones(2, dtype=scale_decay.dtype)
    center_decay = one * jnp.exp(-dt / errors.center_time_constant)
    decay = jnp.concatenate([scale_decay, one, center_decay])
    variance = jnp.concatenate([errors.scale_variance, 0.0 * one, errors.center_variance * one])
    walk = jnp.pad(jnp.full(2, errors.bearing_process_variance * dt), (2, 2))
    slow_process_variance = variance * (1.0 - decay**2) + walk
    identity = jnp.eye(3, dtype=scale_decay.dtype)
    velocity_process_covariance = burn_covariance + tuning.relative_acceleration_noise**2 * dt * identity
    gravity_gradient = two_body_gravity.gravity_gradient(r_SN_N)
    lasting, added = estimate.burn_scale, None
    if delta_v_N is not None:
        lasting, added = burn_scale.propagated(lasting, gravity_gradient, decay, -delta_v_N, dt)
    covariance = orbit_covariance.propagate(
        estimate.covariance, gravity_gradient, decay, velocity_process_covariance, slow_process_variance, dt, added
    )
    return replace(
        estimate,
        r_TS_N=r_TS_N,
        v_TS_N=v_TS_N,
        scale=scale_decay * estimate.scale,
        center_offset=center_decay * estimate.center_offset,
        covariance=covariance,
        outline=outline_correlation.elapse(estimate.outline, dt),
        burn_scale=lasting,
    )


@pytree
class ExpectedBox:
    """Box expected before the measurement, slowly varying errors included, with its uncertainty.

    Attributes:
        values: (3,) tangents and log-size
        variance: (3,) of the present box about these, or of an untruncated one if there is none
        in_front: () bool, the target is predicted well in front of the camera; else the values mean nothing
    """

    values: Array
    variance: Array
    in_front: Array


@dataclass(frozen=True)
class _PriorBox:
    """Box by the prior estimate, compared with the measured one.

    Attributes:
        predicted: (3,) tangents and log-size at the prior position
        reference: (3,) position at which the box is linearised: the prior one, or that of the box itself if the prior
            range is too uncertain [m]
        model: linearised there
        residual: (3,) measured less predicted, of tangents and log-size
        slow_errors: (3,) estimated errors of tangents and log-size
        measured: (3,) tangents and log-size less these
        process_variance: (12,) of the attitude drift since the last frame
        innovation_variance: (3,)
        variance: (3,) part of it that comes from the state
        untruncated_variance: () of a tangent by a box that the frame does not cut
        is_wide: () bool, the prior bearing is much less certain than a box
        range_is_wide: () bool, there is a box, and the prior range is much less certain, too
        in_front: () bool, the target is predicted well in front of the camera
    """

    predicted: Array
    reference: Array
    model: LinearisedBox
    residual: Array
    slow_errors: Array
    measured: Array
    process_variance: Array
    innovation_variance: Array
    variance: Array
    untruncated_variance: Array
    is_wide: Array
    range_is_wide: Array
    in_front: Array


def update(
    tuning: OrbitFilterTuning,
    gated: bool,
    focal_px: Scalar,
    estimate: RelativeEstimate,
    gate: GateState,
    q_KN: Float[Array, "4"],
    box: BoxMeasurement,
) -> tuple[RelativeEstimate, GateState, KalmanUpdate, Bool[Array, ""], ExpectedBox]:
    """Estimate after a box that passes the gate, state of the gate, whether the box was used, and the expected box.

    `q_KN` is the camera's attitude by the attitude filter.
    """
    R_KN = quaternion.to_matrix(q_KN)
    prior = _prior_box(tuning, focal_px, R_KN, estimate, box)
    decision = _decide(tuning, gated, focal_px, R_KN, gate, prior, box)
    model, rows = _measurement_rows(tuning, focal_px, R_KN, estimate, prior, box, decision)
    rejected = box.present & ~decision.accepted
    gate, recover = outlier_gate.update(tuning, gate, q_KN, box, rejected, decision.confirmed)
    jacobian_times_covariance = _jacobian_times_covariance(estimate.covariance, model)
    result, gains = kalman_update.update_with_gains(
        estimate.covariance,
        rows,
        jacobian_times_covariance,
        process_variance=prior.process_variance,
        inflation_variance=recovery_variance(tuning, estimate.r_TS_N, recover),
    )
    outline = _updated_outline(tuning, focal_px, estimate, box, decision.accepted)
    lasting = burn_scale.updated(estimate.burn_scale, rows, gains)
    after = corrected(estimate, result, outline, lasting)
    return after, gate, result, decision.accepted, _expected_box(prior, box)


def rows_of_box(
    tuning: OrbitFilterTuning,
    gated: bool,
    focal_px: Scalar,
    estimate: RelativeEstimate,
    q_KN: Array,
    box: BoxMeasurement,
) -> tuple[MeasurementRows, Bool[Array, ""]]:
    """Rows for the update of a larger filter of which `estimate` is a part, and whether the box is used.

    The box has passed a gate before: that of the camera's own computer. With `gated` it must be as the larger filter
    expects it, too. A size that follows from a frame without a box is a row as well.
    """
    R_KN = quaternion.to_matrix(q_KN)
    prior = _prior_box(tuning, focal_px, R_KN, estimate, box)
    accepted = box.present
    if gated:
        possible = prior.in_front | prior.range_is_wide
        accepted = accepted & possible & outlier_gate.is_inside(tuning, box, prior.residual, prior.innovation_variance)
    decision = GateDecision(
        accepted=accepted, weight=jnp.where(accepted, 1.0, 0.0), confirmed=jnp.zeros_like(box.present)
    )
    _, rows = _measurement_rows(tuning, focal_px, R_KN, estimate, prior, box, decision)
    return rows, accepted


def recovery_variance(tuning: OrbitFilterTuning, r_TS_N: Vector, recover: Bool[Array, ""]) -> Float[Array, "12"]:
    """Covariance inflation after too many rejections, so that the filter accepts the target's boxes again."""
    square = jnp.sum(r_TS_N * r_TS_N, axis=0)
    position = jnp.where(recover, tuning.recovery_position_sigma**2 * square, 0.0)
    velocity = jnp.where(recover, tuning.recovery_velocity_sigma**2, 0.0)
    of_position, of_velocity = jnp.repeat(jnp.eye(2, 4, dtype=square.dtype), 3, axis=1)
    return of_position * position + of_velocity * velocity


def _prior_box(
    tuning: OrbitFilterTuning, focal_px: Scalar, R_KN: Matrix, estimate: RelativeEstimate, box: BoxMeasurement
) -> _PriorBox:
    """Box by the prior estimate, compared with the measured one."""
    # Without stars the attitude error is a slow drift, not white noise; it adds to the bearing bias.
    process_variance = jnp.pad(jnp.full(2, box.attitude_variance_change), (8, 2))
    r_TS_N = estimate.r_TS_N
    at_prior = linearise_box(tuning, focal_px, R_KN, r_TS_N, box, estimate.scale[0])
    bearing_error = estimate.bearing_bias + at_prior.inverse_depth * estimate.center_offset
    slow_errors = jnp.concatenate([bearing_error, jnp.sum(estimate.scale, axis=0)[None]])
    measured = jnp.concatenate([box.tangent, box.log_size[None]]) - slow_errors
    range_is_wide = box.present & box_position.is_range_wide(r_TS_N, estimate.covariance[:3, :3])
    reference = jnp.where(range_is_wide, box_position.position_by_box(R_KN, tuning.target_size, measured), r_TS_N)
    model = linearise_box(tuning, focal_px, R_KN, reference, box, estimate.scale[0])
    innovation_variance = _innovation_variance(estimate.covariance, process_variance[8:10], model)
    variance = innovation_variance - model.variance
    # Compared with an untruncated box: the large noise of a truncated one would make any prior look certain enough.
    untruncated_variance = box_measurement_model.untruncated_bearing_variance(tuning, focal_px)
    is_wide = jnp.any(variance[:2] > tuning.confirm_above**2 * untruncated_variance, axis=0)
    return _PriorBox(
        predicted=at_prior.predicted,
        reference=reference,
        model=model,
        residual=measured - model.predicted - apply(model.position_jacobian, r_TS_N - reference),
        slow_errors=slow_errors,
        measured=measured,
        process_variance=process_variance,
        innovation_variance=innovation_variance,
        variance=variance,
        untruncated_variance=untruncated_variance,
        is_wide=is_wide,
        range_is_wide=range_is_wide,
        in_front=box_measurement_model.is_in_front(R_KN, estimate.r_TS_N),
    )


def _decide(
    tuning: OrbitFilterTuning,
    gated: bool,
    focal_px: Scalar,
    R_KN: Matrix,
    gate: GateState,
    prior: _PriorBox,
    box: BoxMeasurement,
) -> GateDecision:
    """Whether the box is used; without a gate every box is."""
    if not gated:
        return GateDecision(
            accepted=box.present, weight=jnp.where(box.present, 1.0, 0.0), confirmed=jnp.zeros_like(box.present)
        )
    possible = (prior.in_front | prior.range_is_wide) & (
        ~box.truncated | box_measurement_model.may_be_truncated(tuning, prior.model, prior.variance, box)
    )
    return outlier_gate.accept(
        tuning, focal_px, R_KN, gate, box, prior.residual, prior.innovation_variance, prior.is_wide, possible
    )


def _measurement_rows(
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    R_KN: Matrix,
    estimate: RelativeEstimate,
    prior: _PriorBox,
    box: BoxMeasurement,
    decision: GateDecision,
) -> tuple[LinearisedBox, MeasurementRows]:
    """Box at the linearisation point, and its rows for the update."""
    # Linearising at the posterior lets the noise of a box rotate its own Jacobian, which biases the range by decimetres
    # per hour; so only while the prior is much wider than the box, where linearising at the prior would be worse.
    iterated = _iterated_position(tuning, focal_px, R_KN, estimate, box, prior.measured)
    linearisation_point = jnp.where(prior.is_wide & ~prior.range_is_wide, iterated, prior.reference)
    model = linearise_box(tuning, focal_px, R_KN, linearisation_point, box, estimate.scale[0])
    residual = prior.measured - model.predicted - apply(model.position_jacobian, estimate.r_TS_N - linearisation_point)
    size = _size_row(tuning, focal_px, prior, box, decision, residual[2], model.variance[2])
    rows = MeasurementRows(
        residual=jnp.concatenate([residual[:2], size[:1]]),
        jacobian=_jacobian(model),
        variance=jnp.concatenate([model.variance[:2], size[1:2]]),
        weight=jnp.stack([decision.weight, decision.weight, size[2]]),
    )
    return model, rows


def _size_row(
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    prior: _PriorBox,
    box: BoxMeasurement,
    decision: GateDecision,
    residual: Scalar,
    variance: Scalar,
) -> Vector:
    """Residual, variance and weight of the log-size, measured by the box, and by whether there is one."""
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
    variance = jnp.where(whole, variance, _PART_SIZE_SIGMA**2)
    precision = measured / variance + found.precision
    known = precision > _LEAST_PRECISION
    safe = jnp.where(known, precision, 1.0)
    return jnp.stack([(measured * residual / variance + found.residual) / safe, 1.0 / safe, jnp.where(known, 1.0, 0.0)])


_PART_SIZE_SIGMA = 0.5
"""Sigma of the log-size of the target by the box of a part of it [-]."""

_LEAST_PRECISION = 1e-6
"""Precision below which a frame tells nothing of the size."""


def _updated_outline(
    tuning: OrbitFilterTuning, focal_px: Scalar, estimate: RelativeEstimate, box: BoxMeasurement, accepted: Array
) -> OutlineCorrelation:
    """Correlation of the outline after a box; the noise is that of the expected size."""
    side_px = focal_px * tuning.target_size / gradient_safe.norm(estimate.r_TS_N)
    noise_variance = _ASPECT_NOISE_FACTOR * (tuning.edge_noise / side_px) ** 2
    return outline_correlation.update(estimate.outline, box.log_aspect, noise_variance, accepted & ~box.truncated)


_ASPECT_NOISE_FACTOR = 4.5
"""Variance of the log aspect ratio over that of an edge in units of the size: 4 for a square, more for other shapes."""


def corrected(
    estimate: RelativeEstimate, result: KalmanUpdate, outline: OutlineCorrelation, lasting: BurnScale
) -> RelativeEstimate:
    """Estimate with the correction of an update, with the `lasting` error of burns after it."""
    x = result.deviation
    return RelativeEstimate(
        r_TS_N=estimate.r_TS_N + x[:3],
        v_TS_N=estimate.v_TS_N + x[3:6],
        scale=estimate.scale + x[6:8],
        bearing_bias=estimate.bearing_bias + x[8:10],
        center_offset=estimate.center_offset + x[10:12],
        covariance=result.covariance[:12, :12],
        outline=outline,
        burn_scale=lasting,
    )


def _expected_box(prior: _PriorBox, box: BoxMeasurement) -> ExpectedBox:
    """Expected box with the noise of the present one, or of an untruncated one if there is none."""
    untruncated = jnp.stack([prior.untruncated_variance, prior.untruncated_variance, prior.model.variance[2]])
    noise = jnp.where(box.present, prior.model.variance, untruncated)
    return ExpectedBox(
        values=prior.predicted + prior.slow_errors, variance=prior.variance + noise, in_front=prior.in_front
    )


def _jacobian(model: LinearisedBox) -> Float[Array, "3 12"]:
    """Derivative of the box to the state."""
    dtype = model.position_jacobian.dtype
    scale = jnp.array([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0]], dtype=dtype)
    bearing = jnp.eye(3, 2, dtype=dtype)
    columns = [model.position_jacobian, jnp.zeros((3, 3), dtype=dtype), scale, bearing, model.inverse_depth * bearing]
    return jnp.concatenate(columns, axis=1)


def _jacobian_times_covariance(P: Float[Array, "12 12"], model: LinearisedBox) -> Float[Array, "3 12"]:
    """Jacobian times covariance, by the columns of the Jacobian that are not zero."""
    position = product(model.position_jacobian, P[:3])
    d = model.inverse_depth
    # Row by row: the update takes them one by one, and XLA need not join them.
    return jnp.stack([position[0] + P[8] + d * P[10], position[1] + P[9] + d * P[11], position[2] + P[6] + P[7]])


def _innovation_variance(
    P: Float[Array, "12 12"], bearing_process_variance: Float[Array, "2"], model: LinearisedBox
) -> Vector:
    """Variance of the box residuals, with process variance added to that of the bearing bias.

    Of each row of the Jacobian it adds up position, slow errors and their covariance: the others are zero.
    """
    G, d = model.position_jacobian, model.inverse_depth
    GP = product(G, P[:3, :3])
    with_errors = jnp.concatenate([P[8:10, :3] + d * P[10:12, :3], P[6:7, :3] + P[7:8, :3]], axis=0)
    bearing = [
        P[bias, bias] + bearing_process_variance[axis] + d * (2.0 * P[bias, center] + d * P[center, center])
        for axis, (bias, center) in enumerate(((8, 10), (9, 11)))
    ]
    size = P[6, 6] + 2.0 * P[6, 7] + P[7, 7]
    return jnp.sum((GP + 2.0 * with_errors) * G, axis=1) + jnp.stack([*bearing, size]) + model.variance


def _iterated_position(
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    R_KN: Matrix,
    estimate: RelativeEstimate,
    box: BoxMeasurement,
    measured: Vector,
) -> Vector:
    """Linearisation point near the posterior: two Gauss-Newton steps of an iterated filter on the bearing.

    A bearing far more certain than the prior must be linearised along the measured direction, or the long axis of the
    updated covariance points the wrong way.
    """
    P = estimate.covariance[:3, :3]
    point = estimate.r_TS_N
    for _ in range(2):
        model = linearise_box(tuning, focal_px, R_KN, point, box, estimate.scale[0])
        G = model.position_jacobian[:2]
        residual = measured[:2] - model.predicted[:2] - jnp.sum(G * (estimate.r_TS_N - point)[None, :], axis=1)
        PG = jnp.sum(P[:, None, :] * G[None, :, :], axis=2)
        S = jnp.sum(G[:, :, None] * PG[None, :, :], axis=1)
        noise = (
            model.variance[:2]
            + tuning.bearing_bias_sigma**2
            + model.inverse_depth**2 * shape_errors.center_variance(tuning, estimate.scale[0], point)
        )
        a, b, c = S[0, 0] + noise[0], S[0, 1], S[1, 1] + noise[1]
        solved = jnp.stack([c * residual[0] - b * residual[1], a * residual[1] - b * residual[0]]) / (a * c - b * b)
        point = estimate.r_TS_N + jnp.sum(PG * solved[None, :], axis=1)
    return point


def widen(estimate: RelativeEstimate, search_failed: Bool[Array, ""]) -> RelativeEstimate:
    """Estimate with twice the variance of position and velocity if the target is not where it should be."""
    factor = jnp.where(search_failed, jnp.sqrt(_WIDENING), 1.0)
    factors = jnp.concatenate([jnp.full(6, factor), jnp.ones(6, dtype=factor.dtype)])
    lasting = replace(estimate.burn_scale, covariance=factors * estimate.burn_scale.covariance)
    widened = estimate.covariance * (factors[:, None] * factors[None, :])
    return replace(estimate, covariance=widened, burn_scale=lasting)


_WIDENING = 2.0
"""Factor on the variance of position and velocity after a search of all directions that they allow."""
