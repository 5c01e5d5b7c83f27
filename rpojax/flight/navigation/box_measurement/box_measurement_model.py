"""Measurement model of a bounding box: bearing tangents and log-size of the target, linearised, with their noise."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.core.vectors import apply
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, BoxView

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Matrix = Float[Array, "3 3"]

# Width and height differ, so that the log of sqrt(w h) is somewhat noisier than that of a square of the same area.
_SIZE_VARIANCE_FACTOR = 1.5

# Largest ratio of the longer side of a box to the geometric mean of its sides.
_MAX_ASPECT_RATIO = 1.8

# A target predicted more than 60 deg off the boresight cannot be what the camera sees, and tangents diverge there.
_MIN_DEPTH_RATIO = 0.5


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
    tuning: OrbitFilterTuning, view: BoxView, r_TS_N: Vector, slow_scale: Scalar | float = 0.0
) -> LinearisedBox:
    """Linearised box of a target at `r_TS_N` [m] without its slowly varying errors.

    `slow_scale` [-] is the estimated log of its size over the expected one, which determines the noise of the size.
    """
    box, focal_px, R_KN = view.box, view.focal_px, view.R_KN
    r_K = apply(R_KN, r_TS_N)
    distance_squared = jnp.sum(r_TS_N * r_TS_N, axis=0)
    distance = jnp.sqrt(distance_squared)
    depth = jnp.maximum(r_K[2], _MIN_DEPTH_RATIO * distance)
    tangent = r_K[:2] / depth
    predicted = jnp.concatenate([tangent, jnp.log(tuning.target_size / distance)[None]])
    position_jacobian = jnp.stack(
        [
            (R_KN[0] - tangent[0] * R_KN[2]) / depth,
            (R_KN[1] - tangent[1] * R_KN[2]) / depth,
            -r_TS_N / distance_squared,
        ]
    )
    # A truncated box still gives the bearing to about half of its own size.
    truncation_sigma_px = jnp.where(box.truncated, 0.5 * box.side_px, 0.0)
    bearing = untruncated_bearing_variance(tuning, focal_px) + truncation_sigma_px**2 / focal_px**2
    expected_px = focal_px * tuning.target_size * jnp.exp(slow_scale) / distance
    size = _SIZE_VARIANCE_FACTOR * (tuning.edge_noise / expected_px) ** 2
    return LinearisedBox(
        predicted=predicted,
        position_jacobian=position_jacobian,
        inverse_depth=1.0 / depth,
        variance=jnp.stack([bearing, bearing, size]),
    )


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
