"""The target half of the orbit filter: target relative to servicer from bounding boxes.

State (12): position and velocity of the target from the servicer in N; log of the apparent size over its expected
value, in a slow and a fast part (2); bearing bias (2); place of the box centre from the centre of mass, which wanders
as the target tumbles (2).
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update, quaternion
from rpojax.core.frames import apply
from rpojax.core.kalman_update import KalmanUpdate, MeasurementRows
from rpojax.core.numerics import safe
from rpojax.core.orbits import orbital_mechanics
from rpojax.core.pytree import pytree, replace
from rpojax.flight.navigation import orbit_covariance, outlier_gate
from rpojax.flight.navigation.filter_tuning import BoxMeasurement, OrbitFilterTuning
from rpojax.flight.navigation.outlier_gate import GateState

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Matrix = Float[Array, "3 3"]

# Width and height differ, so that the log of sqrt(w h) is somewhat noisier than that of a square of the same area.
_SIZE_VARIANCE_FACTOR = 1.5

# The longer side of a box over the geometric mean of its sides, at most.
_MAX_ASPECT_RATIO = 1.8

# A target predicted more than 60 deg off the boresight cannot be what the camera sees, and tangents explode there.
_MIN_DEPTH_RATIO = 0.5


@pytree
class RelativeEstimate:
    """Mean and covariance of the target half.

    Attributes:
        r_TS_N: (3,) target from servicer [m]
        v_TS_N: (3,) its inertial derivative [m/s]
        scale: (2,) log-size error, slow and fast part [-]
        bearing_bias: (2,) tangents in the camera [rad]
        center: (2,) of the box from the centre of mass, image right and down [m]
        covariance: (12, 12) in this order
    """

    r_TS_N: Array
    v_TS_N: Array
    scale: Array
    bearing_bias: Array
    center_offset: Array
    covariance: Array


def initial_sigma(tuning: OrbitFilterTuning) -> Float[Array, "12"]:
    """1-sigma of every state at hand-over."""
    return jnp.concatenate(
        [
            jnp.full(3, tuning.initial_relative_position_sigma),
            jnp.full(3, tuning.initial_relative_velocity_sigma),
            tuning.scale_sigma,
            jnp.full(2, tuning.bearing_bias_sigma),
            jnp.full(2, tuning.center_sigma),
        ]
    )


def initial(tuning: OrbitFilterTuning, r_TS_N: Vector, v_TS_N: Vector) -> RelativeEstimate:
    """Estimate at hand-over from given means [m, m/s]."""
    return RelativeEstimate(
        r_TS_N=r_TS_N,
        v_TS_N=v_TS_N,
        scale=jnp.zeros_like(tuning.scale_sigma),
        bearing_bias=jnp.zeros(2, dtype=r_TS_N.dtype),
        center_offset=jnp.zeros(2, dtype=r_TS_N.dtype),
        covariance=jnp.diag(initial_sigma(tuning) ** 2),
    )


def predict(
    tuning: OrbitFilterTuning,
    estimate: RelativeEstimate,
    r_TS_N: Vector,
    v_TS_N: Vector,
    r_SN_N: Vector,
    burn_covariance: Matrix,
    dt: float,
) -> RelativeEstimate:
    """Estimate `dt` [s] later with its mean already propagated; `r_SN_N` [m] is the servicer's position before."""
    scale_decay = jnp.exp(-dt / tuning.scale_time_constant)
    one = jnp.ones(2, dtype=scale_decay.dtype)
    center_decay = one * jnp.exp(-dt / tuning.center_time_constant)
    decay = jnp.concatenate([scale_decay, one, center_decay])
    sigma = jnp.concatenate([tuning.scale_sigma, 0.0 * one, tuning.center_sigma * one])
    slow_process_variance = sigma**2 * (1.0 - decay**2)
    identity = jnp.eye(3, dtype=scale_decay.dtype)
    velocity_process_covariance = burn_covariance + tuning.relative_acceleration_noise**2 * dt * identity
    gravity_gradient = orbital_mechanics.gravity_gradient(r_SN_N)
    return replace(
        estimate,
        r_TS_N=r_TS_N,
        v_TS_N=v_TS_N,
        scale=scale_decay * estimate.scale,
        center_offset=center_decay * estimate.center_offset,
        covariance=orbit_covariance.propagate(
            estimate.covariance, gravity_gradient, decay, velocity_process_covariance, slow_process_variance, dt
        ),
    )


@pytree
class LinearisedBox:
    """The box as predicted, linearised at some relative position.

    Attributes:
        predicted: (3,) tangents and log-size
        gradient: (3, 3) their derivative to the relative position in N
        inverse_depth: () derivative of the tangents to the place of the box centre [1/m]
        variance: (3,) measurement noise
    """

    predicted: Array
    position_jacobian: Array
    inverse_depth: Array
    variance: Array


def linearise_box(
    tuning: OrbitFilterTuning, focal_px: Scalar, R_KN: Matrix, r_TS_N: Vector, box: BoxMeasurement
) -> LinearisedBox:
    """Box of a target at `r_TS_N` [m] without its slowly varying errors, and how uncertain a measurement of it is."""
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
    # A cut box still says in which direction the target is, to about half of its own size.
    truncation_sigma_px = jnp.where(box.truncated, 0.5 * box.side_px, 0.0)
    bearing = _untruncated_bearing_variance(tuning, focal_px) + truncation_sigma_px**2 / focal_px**2
    expected_px = focal_px * tuning.target_size / distance
    size = _SIZE_VARIANCE_FACTOR * (tuning.edge_noise / expected_px) ** 2
    return LinearisedBox(
        predicted=predicted,
        position_jacobian=position_jacobian,
        inverse_depth=1.0 / depth,
        variance=jnp.stack([bearing, bearing, size]),
    )


def _untruncated_bearing_variance(tuning: OrbitFilterTuning, focal_px: Scalar) -> Scalar:
    """Variance of a tangent measured by a box that no edge of the frame cuts."""
    return 0.5 * tuning.edge_noise**2 / focal_px**2 + tuning.attitude_sigma**2


@pytree
class ExpectedBox:
    """Where the box is expected before it is looked at, slowly varying errors included, and how much it may be off.

    Attributes:
        values: (3,) tangents and log-size
        variance: (3,) of what the present box may be off, or without one a whole box
        ahead: () bool, the target is predicted well in front of the camera; else the values mean nothing
    """

    values: Array
    variance: Array
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
    """Estimate after a box, if it passes the gate, whether it did, and where one was expected.

    `q_KN` is known from the attitude filter.
    """
    R_KN = quaternion.to_matrix(q_KN)
    # Without stars the attitude error is one slow drift, not white noise; it enters where slow bearing errors live.
    attitude_process_variance = jnp.pad(jnp.full(2, box.attitude_variance_change), (8, 2))
    prior = linearise_box(tuning, focal_px, R_KN, estimate.r_TS_N, box)
    bearing_error = estimate.bearing_bias + prior.inverse_depth * estimate.center_offset
    slow_errors = jnp.concatenate([bearing_error, jnp.sum(estimate.scale, axis=0)[None]])
    measured = jnp.concatenate([box.tangent, box.log_size[None]]) - slow_errors
    variance = _innovation_variance(estimate.covariance, attitude_process_variance, prior)
    # What a whole box would know counts: a cut one is vague itself, and would make any prior look certain enough.
    prior_variance = variance - prior.variance
    untruncated_variance = _untruncated_bearing_variance(tuning, focal_px)
    prior_is_wide = jnp.any(prior_variance[:2] > tuning.confirm_above**2 * untruncated_variance, axis=0)
    in_front = _is_in_front(R_KN, estimate.r_TS_N)
    accepted = jnp.where(box.present, 1.0, 0.0)
    if gated:
        possible = in_front & (~box.truncated | _may_be_truncated(tuning, prior, prior_variance, box))
        residual = measured - prior.predicted
        accepted = outlier_gate.accept(tuning, focal_px, R_KN, gate, box, residual, variance, prior_is_wide, possible)

    # Linearising at the posterior lets the noise of a box turn its own Jacobian, which biases the range by a drift of
    # decimetres per hour; so only while the prior is much wider than the box, where linearising there would be worse.
    iterated = _iterated_position(tuning, focal_px, R_KN, estimate, box, measured)
    linearisation_point = jnp.where(prior_is_wide, iterated, estimate.r_TS_N)
    model = linearise_box(tuning, focal_px, R_KN, linearisation_point, box)
    rows = MeasurementRows(
        residual=measured - model.predicted - apply(model.position_jacobian, estimate.r_TS_N - linearisation_point),
        jacobian=_jacobian(model),
        variance=model.variance,
        weight=jnp.stack([accepted, accepted, jnp.where(box.truncated, 0.0, accepted)]),
    )
    used = accepted > 0.5
    gate, recover = outlier_gate.update(tuning, gate, q_KN, box, box.present & ~used)
    jacobian_times_covariance, recovery_variance = (
        _jacobian_times_covariance(estimate.covariance, model),
        _recovery_variance(tuning, estimate.r_TS_N, recover),
    )
    result = kalman_update.update(
        estimate.covariance,
        rows,
        jacobian_times_covariance,
        process_variance=attitude_process_variance,
        inflation_variance=recovery_variance,
    )
    x = result.deviation
    corrected = RelativeEstimate(
        r_TS_N=estimate.r_TS_N + x[:3],
        v_TS_N=estimate.v_TS_N + x[3:6],
        scale=estimate.scale + x[6:8],
        bearing_bias=estimate.bearing_bias + x[8:10],
        center_offset=estimate.center_offset + x[10:],
        covariance=result.covariance,
    )
    noise = jnp.where(
        box.present, prior.variance, jnp.stack([untruncated_variance, untruncated_variance, prior.variance[2]])
    )
    expected = ExpectedBox(values=prior.predicted + slow_errors, variance=prior_variance + noise, in_front=in_front)
    return corrected, gate, result, used, expected


def _is_in_front(R_KN: Matrix, r_TS_N: Vector) -> Bool[Array, ""]:
    """True if the target is predicted well in front of the camera."""
    r_K = apply(R_KN, r_TS_N)
    return r_K[2] > _MIN_DEPTH_RATIO * safe.norm(r_K)


def _may_be_truncated(
    tuning: OrbitFilterTuning, prior: LinearisedBox, prior_variance: Vector, box: BoxMeasurement
) -> Bool[Array, ""]:
    """True if the frame may cut the predicted outline, as far as the prior (variance `doubt`) can tell."""
    half_size = 0.5 * jnp.exp(prior.predicted[2] + tuning.gate_sigma * safe.sqrt(prior.variance[2] + prior_variance[2]))
    reach = (
        jnp.abs(prior.predicted[:2]) + tuning.gate_sigma * safe.sqrt(prior_variance[:2]) + _MAX_ASPECT_RATIO * half_size
    )
    return jnp.any(reach > box.half_frame_tangent, axis=0)


def _jacobian(model: LinearisedBox) -> Float[Array, "3 12"]:
    dtype = model.position_jacobian.dtype
    scale = jnp.array([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0]], dtype=dtype)
    bearing = jnp.eye(3, 2, dtype=dtype)
    columns = [model.position_jacobian, jnp.zeros((3, 3), dtype=dtype), scale, bearing, model.inverse_depth * bearing]
    return jnp.concatenate(columns, axis=1)


def _jacobian_times_covariance(P: Float[Array, "12 12"], model: LinearisedBox) -> Float[Array, "3 12"]:
    """Jacobian times covariance, from the few columns of the Jacobian that are not zero."""
    G = model.position_jacobian
    position = G[:, :1] * P[:1] + G[:, 1:2] * P[1:2] + G[:, 2:] * P[2:3]
    bearing = P[8:10] + model.inverse_depth * P[10:12]
    return position + jnp.concatenate([bearing, P[6:7] + P[7:8]], axis=0)


def _innovation_variance(
    P: Float[Array, "12 12"], process_variance: Float[Array, "12"], model: LinearisedBox
) -> Vector:
    """Variance of the box residuals before the update, with variances that the state has gained."""
    H = _jacobian(model)
    return jnp.sum((_jacobian_times_covariance(P, model) + process_variance[None, :] * H) * H, axis=1) + model.variance


def _iterated_position(
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    R_KN: Matrix,
    estimate: RelativeEstimate,
    box: BoxMeasurement,
    measured: Vector,
) -> Vector:
    """Relative position near the posterior, where the box is linearised (two Gauss-Newton steps on the bearing).

    A bearing far more certain than the prior must be linearised along the measured direction, or the squeezed
    covariance points the wrong way.
    """
    P = estimate.covariance[:3, :3]
    point = estimate.r_TS_N
    for _ in range(2):
        model = linearise_box(tuning, focal_px, R_KN, point, box)
        G = model.position_jacobian[:2]
        residual = measured[:2] - model.predicted[:2] - jnp.sum(G * (estimate.r_TS_N - point)[None, :], axis=1)
        PG = jnp.sum(P[:, None, :] * G[None, :, :], axis=2)
        S = jnp.sum(G[:, :, None] * PG[None, :, :], axis=1)
        noise = model.variance[:2] + tuning.bearing_bias_sigma**2 + (model.inverse_depth * tuning.center_sigma) ** 2
        a, b, c = S[0, 0] + noise[0], S[0, 1], S[1, 1] + noise[1]
        solved = jnp.stack([c * residual[0] - b * residual[1], a * residual[1] - b * residual[0]]) / (a * c - b * b)
        point = estimate.r_TS_N + jnp.sum(PG * solved[None, :], axis=1)
    return point


def _recovery_variance(tuning: OrbitFilterTuning, r_TS_N: Vector, recover: Bool[Array, ""]) -> Float[Array, "12"]:
    """Variances that the estimate gets when the filter doubts itself, so that it can find back."""
    square = jnp.sum(r_TS_N * r_TS_N, axis=0)
    added = jnp.concatenate(
        [
            jnp.full(3, tuning.recovery_position_sigma**2 * square),
            jnp.full(3, tuning.recovery_velocity_sigma**2),
            jnp.zeros(6, dtype=square.dtype),
        ]
    )
    return jnp.where(recover, added, 0.0)
