"""Innovation of the relative orbit filter: the measured box compared with the one that the prior estimate expects."""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.core.vectors import apply, product
from rpojax.flight.navigation.box_measurement import box_measurement_model, box_position
from rpojax.flight.navigation.box_measurement.box_measurement_model import LinearisedBox, linearise_box
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, BoxView
from rpojax.flight.navigation.relative_state import RelativeEstimate

Vector = Float[Array, "3"]


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
class PriorBox:
    """Box by the prior estimate, compared with the measured one.

    Attributes:
        predicted: (3,) tangents and log-size at the prior position
        reference: (3,) position at which the box is linearised: the prior one, or that of the box itself if the prior
            range is too uncertain [m]
        model: linearised there
        residual: (3,) measured less predicted, of tangents and log-size
        slow_errors: (3,) estimated errors of tangents and log-size
        measured: (3,) tangents and log-size less these
        process_variance: (n,) of the attitude drift since the last frame
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


def prior_box(tuning: OrbitFilterTuning, view: BoxView, estimate: RelativeEstimate) -> PriorBox:
    """Box by the prior estimate, compared with the measured one."""
    box, R_KN = view.box, view.R_KN
    # Without stars the attitude error is a slow drift, not white noise; it adds to the bearing bias.
    drift = jnp.full(2, box.attitude_variance_change)
    r_TS_N, size = estimate.r_TS_N, estimate.slow["size"]
    at_prior = linearise_box(tuning, view, r_TS_N, size[0])
    bearing_error = estimate.slow["bearing_bias"] + at_prior.inverse_depth * estimate.slow["center_offset"]
    slow_errors = jnp.concatenate([bearing_error, jnp.sum(size, axis=0)[None]])
    measured = jnp.concatenate([box.tangent, box.log_size[None]]) - slow_errors
    range_is_wide = box.present & box_position.is_range_wide(r_TS_N, estimate.position_covariance)
    reference = jnp.where(range_is_wide, box_position.position_by_box(R_KN, tuning.target_size, measured), r_TS_N)
    model = linearise_box(tuning, view, reference, size[0])
    innovation_variance = _innovation_variance(estimate, drift, model)
    variance = innovation_variance - model.variance
    # Compared with an untruncated box: the large noise of a truncated one would make any prior look certain enough.
    untruncated_variance = box_measurement_model.untruncated_bearing_variance(tuning, view.focal_px)
    is_wide = jnp.any(variance[:2] > tuning.confirm_above**2 * untruncated_variance, axis=0)
    return PriorBox(
        predicted=at_prior.predicted,
        reference=reference,
        model=model,
        residual=measured - model.predicted - apply(model.position_jacobian, r_TS_N - reference),
        slow_errors=slow_errors,
        measured=measured,
        process_variance=estimate.layout.vector(bearing_bias=drift),
        innovation_variance=innovation_variance,
        variance=variance,
        untruncated_variance=untruncated_variance,
        is_wide=is_wide,
        range_is_wide=range_is_wide,
        in_front=box_measurement_model.is_in_front(R_KN, estimate.r_TS_N),
    )


def expected_box(prior: PriorBox, box: BoxMeasurement) -> ExpectedBox:
    """Expected box with the noise of the present one, or of an untruncated one if there is none."""
    untruncated = jnp.stack([prior.untruncated_variance, prior.untruncated_variance, prior.model.variance[2]])
    noise = jnp.where(box.present, prior.model.variance, untruncated)
    return ExpectedBox(
        values=prior.predicted + prior.slow_errors, variance=prior.variance + noise, in_front=prior.in_front
    )


def _innovation_variance(
    estimate: RelativeEstimate, bearing_process_variance: Float[Array, "2"], model: LinearisedBox
) -> Vector:
    """Variance of the box residuals, with process variance added to that of the bearing bias.

    Of each row of the Jacobian it adds up position, slow errors and their covariance: the others are zero.
    """
    P, layout = estimate.covariance, estimate.layout
    G, d = model.position_jacobian, model.inverse_depth
    GP = product(G, estimate.position_covariance)
    with_position = P[:, layout["position"]]
    bias, center = layout["bearing_bias"], layout["center_offset"]
    slow, fast = (with_position[place][None] for place in layout.places("size"))
    with_errors = jnp.concatenate([with_position[bias] + d * with_position[center], slow + fast], axis=0)
    bearing = [
        P[i, i] + bearing_process_variance[axis] + d * (2.0 * P[i, j] + d * P[j, j])
        for axis, (i, j) in enumerate(zip(layout.places("bearing_bias"), layout.places("center_offset"), strict=True))
    ]
    i, j = layout.places("size")
    size = P[i, i] + 2.0 * P[i, j] + P[j, j]
    return jnp.sum((GP + 2.0 * with_errors) * G, axis=1) + jnp.stack([*bearing, size]) + model.variance
