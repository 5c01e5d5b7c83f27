"""Extended Kalman filter of the target relative to the servicer, with bounding boxes as measurements.

Its state is that of `relative_state`, its measurement that of `box_measurement`.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update, quaternion
from rpojax.core.kalman_update import KalmanUpdate, MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits import two_body_gravity
from rpojax.core.pytree import replace
from rpojax.core.state_layout import StateLayout
from rpojax.flight.navigation import orbit_covariance, outline_correlation, relative_state
from rpojax.flight.navigation.box_measurement import box_measurement_model, outlier_gate
from rpojax.flight.navigation.box_measurement.box_innovation import ExpectedBox, PriorBox, expected_box, prior_box
from rpojax.flight.navigation.box_measurement.box_measurement_rows import jacobian_times_covariance, measurement_rows
from rpojax.flight.navigation.box_measurement.outlier_gate import GateDecision, GateState
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.outline_correlation import OutlineCorrelation
from rpojax.flight.navigation.relative_state import RelativeEstimate

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Matrix = Float[Array, "3 3"]


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

    `burn_covariance` is that of the new errors of a burn of `delta_v_N` [m/s], which has the lasting errors, too;
    without it these are part of `burn_covariance`.
    """
    decay, slow_process_variance = relative_state.slow_process(tuning, estimate, r_TS_N, v_TS_N, dt)
    identity = jnp.eye(3, dtype=decay.dtype)
    velocity_process_covariance = burn_covariance + tuning.relative_acceleration_noise**2 * dt * identity
    burns = [] if delta_v_N is None else relative_state.burn_effects(estimate.layout, -delta_v_N)
    covariance = orbit_covariance.propagate(
        estimate.covariance,
        two_body_gravity.gravity_gradient(r_SN_N),
        decay,
        velocity_process_covariance,
        slow_process_variance,
        dt,
        burns,
    )
    factors = estimate.layout.after("velocity").split(decay)
    return replace(
        estimate,
        r_TS_N=r_TS_N,
        v_TS_N=v_TS_N,
        slow={name: factors[name] * value for name, value in estimate.slow.items()},
        covariance=covariance,
        outline=outline_correlation.elapse(estimate.outline, dt),
    )


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
    prior = prior_box(tuning, focal_px, R_KN, estimate, box)
    decision = _decide(tuning, gated, R_KN, gate, prior, box)
    model, rows = measurement_rows(tuning, focal_px, R_KN, estimate, prior, box, decision)
    rejected = box.present & ~decision.accepted
    gate, recover = outlier_gate.update(tuning, gate, q_KN, box, rejected, decision.confirmed)
    result = kalman_update.update(
        estimate.covariance,
        rows,
        jacobian_times_covariance(estimate, model),
        process_variance=prior.process_variance,
        inflation_variance=recovery_variance(tuning, estimate.layout, estimate.r_TS_N, recover),
    )
    outline = _updated_outline(tuning, focal_px, estimate, box, decision.accepted)
    after = relative_state.corrected(replace(estimate, outline=outline), result.deviation, result.covariance)
    return after, gate, result, decision.accepted, expected_box(prior, box)


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
    prior = prior_box(tuning, focal_px, R_KN, estimate, box)
    accepted = box.present
    if gated:
        possible = prior.in_front | prior.range_is_wide
        accepted = accepted & possible & outlier_gate.is_inside(tuning, box, prior.residual, prior.innovation_variance)
    decision = GateDecision(
        accepted=accepted, weight=jnp.where(accepted, 1.0, 0.0), confirmed=jnp.zeros_like(box.present)
    )
    _, rows = measurement_rows(tuning, focal_px, R_KN, estimate, prior, box, decision)
    return rows, accepted


def recovery_variance(
    tuning: OrbitFilterTuning, layout: StateLayout, r_TS_N: Vector, recover: Bool[Array, ""]
) -> Float[Array, " n"]:
    """Covariance inflation after too many rejections, so that the filter accepts the target's boxes again."""
    square = jnp.sum(r_TS_N * r_TS_N, axis=0)
    position = jnp.where(recover, tuning.recovery_position_sigma**2 * square, 0.0)
    velocity = jnp.where(recover, tuning.recovery_velocity_sigma**2, 0.0)
    return layout.vector(position=jnp.full(3, position), velocity=jnp.full(3, velocity))


def _decide(
    tuning: OrbitFilterTuning,
    gated: bool,
    R_KN: Matrix,
    gate: GateState,
    prior: PriorBox,
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
        tuning, R_KN, gate, box, prior.residual, prior.innovation_variance, prior.is_wide, possible
    )


def _updated_outline(
    tuning: OrbitFilterTuning, focal_px: Scalar, estimate: RelativeEstimate, box: BoxMeasurement, accepted: Array
) -> OutlineCorrelation:
    """Correlation of the outline after a box; the noise is that of the expected size."""
    side_px = focal_px * tuning.target_size / gradient_safe.norm(estimate.r_TS_N)
    noise_variance = _ASPECT_NOISE_FACTOR * (tuning.edge_noise / side_px) ** 2
    return outline_correlation.update(estimate.outline, box.log_aspect, noise_variance, accepted & ~box.truncated)


_ASPECT_NOISE_FACTOR = 4.5
"""Variance of the log aspect ratio over that of an edge in units of the size: 4 for a square, more for other shapes."""
