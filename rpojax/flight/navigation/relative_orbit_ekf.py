"""Extended Kalman filter of the target relative to the servicer, with bounding boxes as measurements.

Its state is that of `relative_state`, its measurement that of `box_measurement`.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update
from rpojax.core.kalman_update import KalmanUpdate, MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import replace
from rpojax.core.state_layout import StateLayout
from rpojax.flight.navigation import orbit_covariance, outline_correlation, relative_state
from rpojax.flight.navigation.box_measurement import box_measurement_model, outlier_gate
from rpojax.flight.navigation.box_measurement.box_innovation import ExpectedBox, PriorBox, expected_box, prior_box
from rpojax.flight.navigation.box_measurement.box_measurement_rows import jacobian_times_covariance, measurement_rows
from rpojax.flight.navigation.box_measurement.outlier_gate import GateDecision, GateState
from rpojax.flight.navigation.orbit_covariance import OrbitStep
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxView
from rpojax.flight.navigation.outline_correlation import OutlineCorrelation
from rpojax.flight.navigation.relative_state import RelativeEstimate

Vector = Float[Array, "3"]


def predict(tuning: OrbitFilterTuning, moved: RelativeEstimate, step: OrbitStep) -> RelativeEstimate:
    """Estimate after a step, of which position and velocity have `moved` already."""
    decay, slow_process_variance = relative_state.slow_process(tuning, moved, moved.r_TS_N, moved.v_TS_N, step.dt)
    burns = [] if step.delta_v_N is None else relative_state.burn_effects(moved.layout, -step.delta_v_N)
    noisy = step.with_acceleration_noise(tuning.relative_acceleration_noise)
    factors = moved.layout.after("velocity").split(decay)
    return replace(
        moved,
        slow={name: factors[name] * value for name, value in moved.slow.items()},
        covariance=orbit_covariance.propagate(moved.covariance, noisy, decay, slow_process_variance, burns),
        outline=outline_correlation.elapse(moved.outline, step.dt),
    )


def update(
    tuning: OrbitFilterTuning, gated: bool, estimate: RelativeEstimate, gate: GateState, view: BoxView
) -> tuple[RelativeEstimate, GateState, KalmanUpdate, Bool[Array, ""], ExpectedBox]:
    """Estimate after a box that passes the gate, state of the gate, whether the box was used, and the expected box."""
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
    after = relative_state.corrected(replace(estimate, outline=outline), result.deviation, result.covariance)
    return after, gate, result, decision.accepted, expected_box(prior, view.box)


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
    decision = GateDecision(
        accepted=accepted, weight=jnp.where(accepted, 1.0, 0.0), confirmed=jnp.zeros_like(view.box.present)
    )
    _, rows = measurement_rows(tuning, view, estimate, prior, decision)
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
        return GateDecision(
            accepted=box.present, weight=jnp.where(box.present, 1.0, 0.0), confirmed=jnp.zeros_like(box.present)
        )
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
"""Variance of the log aspect ratio over that of an edge in units of the size: 4 for a square, more for other shapes."""
