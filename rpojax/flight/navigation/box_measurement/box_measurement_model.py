"""Measurement model of a bounding box: the box that an estimate expects, with its noise, and the innovation of one."""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.core.vectors import apply, apply_transposed, product
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, BoxView
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]

_LARGEST_LINEAR_SIGMA = 0.3
"""Sigma of the range over the range up to which the log of the range is nearly linear, twice that of a box [-]: the
square that is left out, 0.045, is less than a third of that of a box."""


def is_range_wide(r_TS_N: Vector, position_covariance: Matrix) -> Bool[Array, ""]:
    """True if the range of a target at `r_TS_N` [m] is too uncertain for a linearisation there."""
    along = jnp.sum(r_TS_N * apply(position_covariance, r_TS_N), axis=0)
    return along > _LARGEST_LINEAR_SIGMA**2 * jnp.sum(r_TS_N * r_TS_N, axis=0) ** 2


def position_by_box(R_KN: Matrix, target_size: Scalar, measured: Vector) -> Vector:
    """Position `r_TS_N` [m] of a target of `target_size` [m] that would have the `measured` (tangents, log-size)."""
    ray_K = jnp.concatenate([measured[:2], jnp.ones_like(measured[:1])])
    return apply_transposed(R_KN, target_size * jnp.exp(-measured[2]) * gradient_safe.normalize(ray_K))


_SIZE_VARIANCE_FACTOR = 1.5
"""Variance of the log of sqrt(w h) over that of an edge in units of it, (w / h + h / w) / 2 [-]: that of a side 2.6
times the other. A choice: the mean over attitudes of the packaged hull is 1.12."""
_MAX_ASPECT_RATIO = 1.8
"""Largest ratio of the longer side of a box to the geometric mean of its sides [-]: 1.78 of the packaged hull."""
_MIN_DEPTH_RATIO = 0.5
"""Cosine of 60 deg: what is predicted farther off is not what the camera sees, and tangents diverge [-]."""
_TRUNCATION_SIGMA = 0.5
"""Sigma of the bearing by a truncated box over its side [-]: the centre may be at its edge."""


@pytree
class LinearisedBox:
    """Predicted box, linearised at a relative position.

    Attributes:
        predicted: (3,) tangents and log-size
        position_jacobian: (3, 3) their derivative to the relative position in N
        inverse_depth: () derivative of the tangents to the offset of the box centre [1/m]
        variance: (3,) measurement noise
    """

    predicted: Array
    position_jacobian: Array
    inverse_depth: Array
    variance: Array


def linearise_box(
    tuning: OrbitFilterTuning,
    view: BoxView,
    r_TS_N: Vector,
    slow_scale: Scalar | float = 0.0,
    bearing_bias: Float[Array, "2"] | None = None,
) -> LinearisedBox:
    """Linearised box of a target at `r_TS_N` [m] without its slowly varying errors.

    The tangents are linearised in the direction in which the target appears, with the `bearing_bias` [-]: along it they
    tell nothing of the range. That direction is known at once; where the target is, only as the bias becomes known, and
    a Jacobian that turned with that knowledge would seem to measure the range (Huang, Mourikis and Roumeliotis,
    Observability-based rules for designing consistent EKF SLAM estimators, 2010).

    Args:
        tuning: of the filter
        view: camera and box
        r_TS_N: (3,) place of the linearisation [m]
        slow_scale: () estimated log of the target's size over the expected one, which determines the noise of the size
        bearing_bias: (2,) estimated bias of the tangents, by default none
    """
    box, focal_px, R_KN = view.box, view.focal_px, view.R_KN
    r_K = apply(R_KN, r_TS_N)
    distance_squared = jnp.sum(r_TS_N * r_TS_N, axis=0)
    distance = jnp.sqrt(distance_squared)
    depth = jnp.maximum(r_K[2], _MIN_DEPTH_RATIO * distance)
    tangent = r_K[:2] / depth
    predicted = jnp.concatenate([tangent, jnp.log(tuning.target_size / distance)[None]])
    apparent = tangent if bearing_bias is None else tangent + bearing_bias
    position_jacobian = jnp.stack(
        [
            (R_KN[0] - apparent[0] * R_KN[2]) / depth,
            (R_KN[1] - apparent[1] * R_KN[2]) / depth,
            -r_TS_N / distance_squared,
        ]
    )
    truncation_sigma_px = jnp.where(box.truncated, _TRUNCATION_SIGMA * box.side_px, 0.0)
    bearing = untruncated_bearing_variance(tuning, focal_px) + truncation_sigma_px**2 / focal_px**2
    expected_px = focal_px * tuning.target_size * jnp.exp(slow_scale) / distance
    size = _SIZE_VARIANCE_FACTOR * (tuning.edge_noise / expected_px) ** 2
    return LinearisedBox(
        predicted=predicted,
        position_jacobian=position_jacobian,
        inverse_depth=1.0 / depth,
        variance=jnp.stack([bearing, bearing, size]),
    )


def predicted_at(
    view: BoxView, model: LinearisedBox, bearing_bias: Float[Array, "2"], offset_N: Vector
) -> Float[Array, "3"]:
    """Box at an offset [m] from the place of the linearisation, to first order of where the target is.

    The Jacobian is that of where it appears, which over a long way along the line of sight would make the
    `bearing_bias` a shift of the bearing.
    """
    along = model.inverse_depth * jnp.sum(view.R_KN[2] * offset_N, axis=0)
    shift = apply(model.position_jacobian, offset_N)
    return model.predicted + shift + jnp.concatenate([bearing_bias * along, jnp.zeros_like(shift[:1])])


def untruncated_bearing_variance(tuning: OrbitFilterTuning, focal_px: Scalar) -> Scalar:
    """Variance of a tangent measured by a box that no edge of the frame cuts."""
    return 0.5 * tuning.edge_noise**2 / focal_px**2 + tuning.attitude_sigma**2


def is_in_front(R_KN: Matrix, r_TS_N: Vector) -> Bool[Array, ""]:
    """True if the target at `r_TS_N` [m] is well in front of the camera."""
    r_K = apply(R_KN, r_TS_N)
    return r_K[2] > _MIN_DEPTH_RATIO * gradient_safe.norm(r_K)


def may_be_truncated(
    tuning: OrbitFilterTuning, predicted: LinearisedBox, prior_variance: Vector, box: BoxMeasurement
) -> Bool[Array, ""]:
    """True if the frame may cut the predicted outline within the gate, with the prior's variance of the box."""
    half_size = 0.5 * jnp.exp(
        predicted.predicted[2] + tuning.gate_sigma * gradient_safe.sqrt(predicted.variance[2] + prior_variance[2])
    )
    reach = (
        jnp.abs(predicted.predicted[:2])
        + tuning.gate_sigma * gradient_safe.sqrt(prior_variance[:2])
        + _MAX_ASPECT_RATIO * half_size
    )
    return jnp.any(reach > box.half_frame_tangent, axis=0)


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
    bias = estimate.slow["bearing_bias"]
    at_prior = linearise_box(tuning, view, r_TS_N, size[0], bias)
    bearing_error = bias + at_prior.inverse_depth * estimate.slow["center_offset"]
    slow_errors = jnp.concatenate([bearing_error, jnp.sum(size, axis=0)[None]])
    measured = jnp.concatenate([box.tangent, box.log_size[None]]) - slow_errors
    range_is_wide = box.present & is_range_wide(r_TS_N, estimate.position_covariance)
    reference = jnp.where(range_is_wide, position_by_box(R_KN, tuning.target_size, measured), r_TS_N)
    model = linearise_box(tuning, view, reference, size[0], bias)
    innovation_variance = _innovation_variance(estimate, drift, model)
    variance = innovation_variance - model.variance
    # Compared with an untruncated box: the large noise of a truncated one would make any prior look certain enough.
    untruncated_variance = untruncated_bearing_variance(tuning, view.focal_px)
    is_wide = jnp.any(variance[:2] > tuning.confirm_above**2 * untruncated_variance, axis=0)
    return PriorBox(
        predicted=at_prior.predicted,
        reference=reference,
        model=model,
        residual=measured - predicted_at(view, model, bias, r_TS_N - reference),
        slow_errors=slow_errors,
        measured=measured,
        process_variance=estimate.layout.vector(bearing_bias=drift),
        innovation_variance=innovation_variance,
        variance=variance,
        untruncated_variance=untruncated_variance,
        is_wide=is_wide,
        range_is_wide=range_is_wide,
        in_front=is_in_front(R_KN, estimate.r_TS_N),
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
