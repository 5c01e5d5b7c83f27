"""The target half of the orbit filter: target relative to servicer from bounding boxes.

State (12): position and velocity of the target from the servicer in N; log of the apparent size over its expected
value, in a slow and a fast part (2); bearing bias (2); place of the box centre from the centre of mass, which wanders
as the target tumbles (2).
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update, quaternion
from rpojax.core.frames import apply
from rpojax.core.kalman_update import Rows, Update
from rpojax.core.numerics import safe
from rpojax.core.orbits import orbital_mechanics
from rpojax.core.pytree import pytree, replace
from rpojax.flight.navigation import orbit_covariance, outlier_gate
from rpojax.flight.navigation.filter_tuning import BoxMeasurement, Navigation
from rpojax.flight.navigation.outlier_gate import BoxTrack

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Matrix = Float[Array, "3 3"]

# Width and height differ, so that the log of sqrt(w h) is somewhat noisier than that of a square of the same area.
_ASPECT_FACTOR = 1.5

# The longer side of a box over the geometric mean of its sides, at most.
_WIDEST_ASPECT = 1.8

# A target predicted more than 60 deg off the boresight cannot be what the camera sees, and tangents explode there.
_LEAST_DEPTH = 0.5


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
    center: Array
    covariance: Array


def initial_sigma(tuning: Navigation) -> Float[Array, "12"]:
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


def initial(tuning: Navigation, r_TS_N: Vector, v_TS_N: Vector) -> RelativeEstimate:
    """Estimate at hand-over from given means [m, m/s]."""
    return RelativeEstimate(
        r_TS_N=r_TS_N,
        v_TS_N=v_TS_N,
        scale=jnp.zeros_like(tuning.scale_sigma),
        bearing_bias=jnp.zeros(2, dtype=r_TS_N.dtype),
        center=jnp.zeros(2, dtype=r_TS_N.dtype),
        covariance=jnp.diag(initial_sigma(tuning) ** 2),
    )


def predict(
    tuning: Navigation,
    estimate: RelativeEstimate,
    r_TS_N: Vector,
    v_TS_N: Vector,
    r_SN_N: Vector,
    burn_covariance: Matrix,
    dt: float,
) -> RelativeEstimate:
    """Estimate `dt` [s] later with its mean already propagated; `r_SN_N` [m] is the servicer's position before."""
    decay = jnp.exp(-dt / tuning.scale_time_constant)
    still = jnp.ones(2, dtype=decay.dtype)
    wander = still * jnp.exp(-dt / tuning.center_time_constant)
    factors = jnp.concatenate([decay, still, wander])
    sigma = jnp.concatenate([tuning.scale_sigma, 0.0 * still, tuning.center_sigma * still])
    growth = sigma**2 * (1.0 - factors**2)
    identity = jnp.eye(3, dtype=decay.dtype)
    velocity = burn_covariance + tuning.relative_acceleration_noise**2 * dt * identity
    gradient = orbital_mechanics.gravity_gradient(r_SN_N)
    return replace(
        estimate,
        r_TS_N=r_TS_N,
        v_TS_N=v_TS_N,
        scale=decay * estimate.scale,
        center=wander * estimate.center,
        covariance=orbit_covariance.propagate(estimate.covariance, gradient, factors, velocity, growth, dt),
    )


@pytree
class BoxModel:
    """The box as predicted, linearised at some relative position.

    Attributes:
        predicted: (3,) tangents and log-size
        gradient: (3, 3) their derivative to the relative position in N
        inverse_depth: () derivative of the tangents to the place of the box centre [1/m]
        variance: (3,) measurement noise
    """

    predicted: Array
    gradient: Array
    inverse_depth: Array
    variance: Array


def box_model(tuning: Navigation, focal_px: Scalar, R_KN: Matrix, r_TS_N: Vector, box: BoxMeasurement) -> BoxModel:
    """Box of a target at `r_TS_N` [m] without its slowly varying errors, and how uncertain a measurement of it is."""
    r_K = apply(R_KN, r_TS_N)
    square = jnp.sum(r_TS_N * r_TS_N, axis=0)
    distance = jnp.sqrt(square)
    depth = jnp.maximum(r_K[2], _LEAST_DEPTH * distance)
    tangent = r_K[:2] / depth
    predicted = jnp.concatenate([tangent, jnp.log(tuning.target_size / distance)[None]])
    gradient = jnp.stack(
        [
            (R_KN[0] - tangent[0] * R_KN[2]) / depth,
            (R_KN[1] - tangent[1] * R_KN[2]) / depth,
            -r_TS_N / square,
        ]
    )
    # A cut box still says in which direction the target is, to about half of its own size.
    doubt_px = jnp.where(box.truncated, 0.5 * box.side_px, 0.0)
    bearing = _whole_bearing_variance(tuning, focal_px) + doubt_px**2 / focal_px**2
    expected_px = focal_px * tuning.target_size / distance
    size = _ASPECT_FACTOR * (tuning.edge_noise / expected_px) ** 2
    return BoxModel(
        predicted=predicted, gradient=gradient, inverse_depth=1.0 / depth, variance=jnp.stack([bearing, bearing, size])
    )


def _whole_bearing_variance(tuning: Navigation, focal_px: Scalar) -> Scalar:
    """Variance of a tangent measured by a box that no edge of the frame cuts."""
    return 0.5 * tuning.edge_noise**2 / focal_px**2 + tuning.attitude_sigma**2


@pytree
class Expected:
    """Where the box is expected before it is looked at, slowly varying errors included, and how much it may be off.

    Attributes:
        values: (3,) tangents and log-size
        variance: (3,) of what the present box may be off, or without one a whole box
        ahead: () bool, the target is predicted well in front of the camera; else the values mean nothing
    """

    values: Array
    variance: Array
    ahead: Array


def update(
    tuning: Navigation,
    gated: bool,
    focal_px: Scalar,
    estimate: RelativeEstimate,
    track: BoxTrack,
    q_KN: Float[Array, "4"],
    box: BoxMeasurement,
) -> tuple[RelativeEstimate, BoxTrack, Update, Bool[Array, ""], Expected]:
    """Estimate after a box, if it passes the gate, whether it did, and where one was expected.

    `q_KN` is known from the attitude filter.
    """
    R_KN = quaternion.to_matrix(q_KN)
    # Without stars the attitude error is one slow drift, not white noise; it enters where slow bearing errors live.
    drift = jnp.pad(jnp.full(2, box.attitude_drift), (8, 2))
    prior = box_model(tuning, focal_px, R_KN, estimate.r_TS_N, box)
    bearing_error = estimate.bearing_bias + prior.inverse_depth * estimate.center
    slow = jnp.concatenate([bearing_error, jnp.sum(estimate.scale, axis=0)[None]])
    measured = jnp.concatenate([box.tangent, box.log_size[None]]) - slow
    variance = _innovation_variance(estimate.covariance, drift, prior)
    # What a whole box would know counts: a cut one is vague itself, and would make any prior look certain enough.
    doubt = variance - prior.variance
    whole = _whole_bearing_variance(tuning, focal_px)
    wide = jnp.any(doubt[:2] > tuning.confirm_above**2 * whole, axis=0)
    ahead = _is_ahead(R_KN, estimate.r_TS_N)
    accepted = jnp.where(box.present, 1.0, 0.0)
    if gated:
        possible = ahead & (~box.truncated | _may_be_cut(tuning, prior, doubt, box))
        residual = measured - prior.predicted
        accepted = outlier_gate.accept(tuning, focal_px, R_KN, track, box, residual, variance, wide, possible)

    # Linearising at the posterior lets the noise of a box turn its own Jacobian, which biases the range by a drift of
    # decimetres per hour; so only while the prior is much wider than the box, where linearising there would be worse.
    iterated = _iterated_position(tuning, focal_px, R_KN, estimate, box, measured)
    point = jnp.where(wide, iterated, estimate.r_TS_N)
    model = box_model(tuning, focal_px, R_KN, point, box)
    rows = Rows(
        residual=measured - model.predicted - apply(model.gradient, estimate.r_TS_N - point),
        jacobian=_jacobian(model),
        variance=model.variance,
        weight=jnp.stack([accepted, accepted, jnp.where(box.truncated, 0.0, accepted)]),
    )
    used = accepted > 0.5
    track, lost = outlier_gate.remember(tuning, track, q_KN, box, box.present & ~used)
    crossed, doubtful = _crossed(estimate.covariance, model), _doubt(tuning, estimate.r_TS_N, lost)
    result = kalman_update.update(estimate.covariance, rows, crossed, gained=drift, added=doubtful)
    x = result.deviation
    corrected = RelativeEstimate(
        r_TS_N=estimate.r_TS_N + x[:3],
        v_TS_N=estimate.v_TS_N + x[3:6],
        scale=estimate.scale + x[6:8],
        bearing_bias=estimate.bearing_bias + x[8:10],
        center=estimate.center + x[10:],
        covariance=result.covariance,
    )
    noise = jnp.where(box.present, prior.variance, jnp.stack([whole, whole, prior.variance[2]]))
    expected = Expected(values=prior.predicted + slow, variance=doubt + noise, ahead=ahead)
    return corrected, track, result, used, expected


def _is_ahead(R_KN: Matrix, r_TS_N: Vector) -> Bool[Array, ""]:
    """True if the target is predicted well in front of the camera."""
    r_K = apply(R_KN, r_TS_N)
    return r_K[2] > _LEAST_DEPTH * safe.norm(r_K)


def _may_be_cut(tuning: Navigation, prior: BoxModel, doubt: Vector, box: BoxMeasurement) -> Bool[Array, ""]:
    """True if the frame may cut the predicted outline, as far as the prior (variance `doubt`) can tell."""
    half_size = 0.5 * jnp.exp(prior.predicted[2] + tuning.gate_sigma * safe.sqrt(prior.variance[2] + doubt[2]))
    reach = jnp.abs(prior.predicted[:2]) + tuning.gate_sigma * safe.sqrt(doubt[:2]) + _WIDEST_ASPECT * half_size
    return jnp.any(reach > box.half_frame, axis=0)


def _jacobian(model: BoxModel) -> Float[Array, "3 12"]:
    dtype = model.gradient.dtype
    scale = jnp.array([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0]], dtype=dtype)
    bearing = jnp.eye(3, 2, dtype=dtype)
    columns = [model.gradient, jnp.zeros((3, 3), dtype=dtype), scale, bearing, model.inverse_depth * bearing]
    return jnp.concatenate(columns, axis=1)


def _crossed(P: Float[Array, "12 12"], model: BoxModel) -> Float[Array, "3 12"]:
    """Jacobian times covariance, from the few columns of the Jacobian that are not zero."""
    G = model.gradient
    position = G[:, :1] * P[:1] + G[:, 1:2] * P[1:2] + G[:, 2:] * P[2:3]
    bearing = P[8:10] + model.inverse_depth * P[10:12]
    return position + jnp.concatenate([bearing, P[6:7] + P[7:8]], axis=0)


def _innovation_variance(P: Float[Array, "12 12"], gained: Float[Array, "12"], model: BoxModel) -> Vector:
    """Variance of the box residuals before the update, with variances that the state has gained."""
    H = _jacobian(model)
    return jnp.sum((_crossed(P, model) + gained[None, :] * H) * H, axis=1) + model.variance


def _iterated_position(
    tuning: Navigation,
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
        model = box_model(tuning, focal_px, R_KN, point, box)
        G = model.gradient[:2]
        residual = measured[:2] - model.predicted[:2] - jnp.sum(G * (estimate.r_TS_N - point)[None, :], axis=1)
        PG = jnp.sum(P[:, None, :] * G[None, :, :], axis=2)
        S = jnp.sum(G[:, :, None] * PG[None, :, :], axis=1)
        noise = model.variance[:2] + tuning.bearing_bias_sigma**2 + (model.inverse_depth * tuning.center_sigma) ** 2
        a, b, c = S[0, 0] + noise[0], S[0, 1], S[1, 1] + noise[1]
        solved = jnp.stack([c * residual[0] - b * residual[1], a * residual[1] - b * residual[0]]) / (a * c - b * b)
        point = estimate.r_TS_N + jnp.sum(PG * solved[None, :], axis=1)
    return point


def _doubt(tuning: Navigation, r_TS_N: Vector, lost: Bool[Array, ""]) -> Float[Array, "12"]:
    """Variances that the estimate gets when the filter doubts itself, so that it can find back."""
    square = jnp.sum(r_TS_N * r_TS_N, axis=0)
    added = jnp.concatenate(
        [
            jnp.full(3, tuning.recovery_position_sigma**2 * square),
            jnp.full(3, tuning.recovery_velocity_sigma**2),
            jnp.zeros(6, dtype=square.dtype),
        ]
    )
    return jnp.where(lost, added, 0.0)
