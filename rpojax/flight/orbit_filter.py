"""Orbit filter: servicer and target jointly from GPS and bounding boxes, with slowly varying errors as states.

State (19): servicer position and velocity, target relative to servicer (position, velocity), all in N; GPS error (3);
log of the apparent size over its expected value, in a slow and a fast part (2); bearing bias (2). GPS touches the first
half, the box the second, so no two 7000 km vectors are ever subtracted.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import orbital_mechanics, quaternion, safe, scalar_update
from rpojax.core.frames import apply
from rpojax.core.integrate import rk4
from rpojax.core.pytree import pytree, replace
from rpojax.core.scalar_update import Rows

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Matrix = Float[Array, "3 3"]

SIZE = 19
POSITION, VELOCITY = slice(0, 3), slice(3, 6)
RELATIVE_POSITION, RELATIVE_VELOCITY = slice(6, 9), slice(9, 12)
GPS_ERROR, SCALE, BEARING_BIAS = slice(12, 15), slice(15, 17), slice(17, 19)
ORBITS = 12
"""The first components are positions and velocities; the rest are nuisance states."""

# Width and height differ, so that the log of sqrt(w h) is somewhat noisier than that of a square of the same area.
_ASPECT_FACTOR = 1.5

# A target predicted more than 60 deg off the boresight cannot be what the camera sees, and tangents explode there.
_LEAST_DEPTH = 0.5


@pytree
class Navigation:
    """Tuning of the orbit filter and of its gate.

    Attributes:
        gps_noise: () white noise per axis, 1 sigma [m]
        gps_error_sigma: () slowly varying error per axis, 1 sigma [m]
        gps_error_time_constant: () [s]
        edge_noise: () of a box edge, 1 sigma [px]
        center_noise: () of the box centre against the centre of mass, 1 sigma [m]
        target_size: () expected sqrt(width height) of the target's outline [m]
        scale_sigma: (2,) log-size error, slow and fast part, 1 sigma [-]
        scale_time_constant: (2,) [s]
        bearing_bias_sigma: () per axis, 1 sigma [rad]
        attitude_sigma: () camera attitude noise per axis, 1 sigma [rad]
        acceleration_noise: () unmodelled absolute acceleration [m/s^2 per Hz^0.5]
        relative_acceleration_noise: () unmodelled relative acceleration [m/s^2 per Hz^0.5]
        burn_magnitude_sigma: () share of a burn's velocity change along it, 1 sigma [-]
        burn_direction_sigma: () share across it, per axis, 1 sigma [rad]
        gate_sigma: () boxes beyond this many sigma in bearing or log-range are rejected [-]
        confirm_tolerance: () two boxes closer than this confirm each other [px]
        confirm_above: () confirmation is asked for when bearing is less certain than this many box sigmas [-]
        confirm_frames: () and only so many frames later [-]
        rejections_before_recovery: () rejections in a row after which the filter doubts itself [-]
        recovery_position_sigma: () position doubt added then, as a share of the range [-]
        recovery_velocity_sigma: () velocity doubt added then [m/s]
        initial_position_sigma: () servicer, per axis [m]
        initial_velocity_sigma: () servicer, per axis [m/s]
        initial_relative_position_sigma: () per axis [m]
        initial_relative_velocity_sigma: () per axis [m/s]
    """

    gps_noise: Array
    gps_error_sigma: Array
    gps_error_time_constant: Array
    edge_noise: Array
    center_noise: Array
    target_size: Array
    scale_sigma: Array
    scale_time_constant: Array
    bearing_bias_sigma: Array
    attitude_sigma: Array
    acceleration_noise: Array
    relative_acceleration_noise: Array
    burn_magnitude_sigma: Array
    burn_direction_sigma: Array
    gate_sigma: Array
    confirm_tolerance: Array
    confirm_above: Array
    confirm_frames: Array
    rejections_before_recovery: Array
    recovery_position_sigma: Array
    recovery_velocity_sigma: Array
    initial_position_sigma: Array
    initial_velocity_sigma: Array
    initial_relative_position_sigma: Array
    initial_relative_velocity_sigma: Array


@pytree
class OrbitEstimate:
    """Mean and covariance.

    Attributes:
        r_SN_N: (3,) servicer position [m]
        v_SN_N: (3,) servicer velocity [m/s]
        r_TS_N: (3,) target from servicer [m]
        v_TS_N: (3,) its inertial derivative [m/s]
        gps_error_N: (3,) [m]
        scale: (2,) log-size error, slow and fast part [-]
        bearing_bias: (2,) tangents in the camera [rad]
        covariance: (19, 19) in this order
    """

    r_SN_N: Array
    v_SN_N: Array
    r_TS_N: Array
    v_TS_N: Array
    gps_error_N: Array
    scale: Array
    bearing_bias: Array
    covariance: Array


@pytree
class BoxMeasurement:
    """A bounding box as the filter sees it.

    Attributes:
        tangent: (2,) of the ray through its centre in camera axes [-]
        log_size: () log of its mean side over the focal length [-]
        side_px: () mean side [px]
        present: () bool
        truncated: () bool, cut by the frame
    """

    tangent: Array
    log_size: Array
    side_px: Array
    present: Array
    truncated: Array


@pytree
class BoxTrack:
    """What the gate remembers.

    Attributes:
        direction_N: (3,) unit vector of the last box
        age: () frames since that box [-]
        rejections: () boxes rejected in a row [-]
    """

    direction_N: Array
    age: Array
    rejections: Array


@pytree
class Innovation:
    """Diagnostics of an update: rows are GPS x, y, z, bearing x, y and log-size.

    Attributes:
        innovation: (6,)
        variance: (6,) its variance as the filter sees it
        log_likelihood: () of the rows used
        accepted: () bool, the box was used
        rejected: () bool, there was a box and it was not used
    """

    innovation: Array
    variance: Array
    log_likelihood: Array
    accepted: Array
    rejected: Array


def initial_sigma(tuning: Navigation) -> Float[Array, "19"]:
    """1-sigma of every state at hand-over; errors at the start of a run are drawn from it."""

    def three(value: Array) -> Array:
        return jnp.full(3, value)

    return jnp.concatenate(
        [
            three(tuning.initial_position_sigma),
            three(tuning.initial_velocity_sigma),
            three(tuning.initial_relative_position_sigma),
            three(tuning.initial_relative_velocity_sigma),
            three(tuning.gps_error_sigma),
            tuning.scale_sigma,
            jnp.full(2, tuning.bearing_bias_sigma),
        ]
    )


def initial(tuning: Navigation, r_SN_N: Vector, v_SN_N: Vector, r_TS_N: Vector, v_TS_N: Vector) -> OrbitEstimate:
    """Estimate at hand-over from given means [m, m/s]."""
    return OrbitEstimate(
        r_SN_N=r_SN_N,
        v_SN_N=v_SN_N,
        r_TS_N=r_TS_N,
        v_TS_N=v_TS_N,
        gps_error_N=jnp.zeros_like(r_SN_N),
        scale=jnp.zeros_like(tuning.scale_sigma),
        bearing_bias=jnp.zeros(2, dtype=r_SN_N.dtype),
        covariance=jnp.diag(initial_sigma(tuning) ** 2),
    )


def initial_track() -> BoxTrack:
    """Memory of the gate before the first frame."""
    return BoxTrack(
        direction_N=jnp.array([0.0, 0.0, 1.0], dtype=jnp.float64),
        age=jnp.full((), 1e6, dtype=jnp.float64),
        rejections=jnp.zeros((), dtype=jnp.float64),
    )


def predict(
    tuning: Navigation, estimate: OrbitEstimate, delta_v_N: Vector, burn_delta_v: Scalar, dt: float
) -> OrbitEstimate:
    """Estimate `dt` [s] later, with the known velocity change [m/s] spread over the step.

    `burn_delta_v` [m/s] is the size of the whole burn: its execution error is one draw for all of its seconds, which the
    covariance honours by giving each second its share of the burn's variance.
    """
    acceleration = delta_v_N / dt

    def derivative(y: tuple[Vector, ...], _: None) -> tuple[Vector, ...]:
        r, v, d, d_dot = y
        return (
            v,
            orbital_mechanics.gravity(r) + acceleration,
            d_dot,
            orbital_mechanics.differential_gravity(r, d) - acceleration,
        )

    mean = (estimate.r_SN_N, estimate.v_SN_N, estimate.r_TS_N, estimate.v_TS_N)
    r, v, d, d_dot = rk4(derivative, mean, (None, None, None), dt)
    decay = jnp.exp(-dt / tuning.scale_time_constant)
    gps_decay = jnp.exp(-dt / tuning.gps_error_time_constant)
    return replace(
        estimate,
        r_SN_N=r,
        v_SN_N=v,
        r_TS_N=d,
        v_TS_N=d_dot,
        gps_error_N=gps_decay * estimate.gps_error_N,
        scale=decay * estimate.scale,
        covariance=_predict_covariance(tuning, estimate, delta_v_N, burn_delta_v, gps_decay, decay, dt),
    )


def _predict_covariance(
    tuning: Navigation,
    estimate: OrbitEstimate,
    delta_v_N: Vector,
    burn_delta_v: Scalar,
    gps_decay: Scalar,
    scale_decay: Float[Array, "2"],
    dt: float,
) -> Float[Array, "19 19"]:
    """Covariance after a kick by the gravity gradient and a drift, which together are symplectic."""
    gradient = dt * orbital_mechanics.gravity_gradient(estimate.r_SN_N)
    factors = jnp.concatenate([jnp.full(3, gps_decay), scale_decay, jnp.ones(2, dtype=scale_decay.dtype)])

    def transition(P: Array) -> Array:
        p, v, d, d_dot, rest = P[:3], P[3:6], P[6:9], P[9:12], P[12:]
        v = v + jnp.sum(gradient[:, :, None] * p[None, :, :], axis=1)
        d_dot = d_dot + jnp.sum(gradient[:, :, None] * d[None, :, :], axis=1)
        return jnp.concatenate([p + dt * v, v, d + dt * d_dot, d_dot, factors[:, None] * rest], axis=0)

    P = transition(transition(estimate.covariance).T)
    burn = _burn_covariance(tuning, delta_v_N, burn_delta_v)
    identity = jnp.eye(3, dtype=P.dtype)
    absolute = burn + tuning.acceleration_noise**2 * dt * identity
    relative = burn + tuning.relative_acceleration_noise**2 * dt * identity
    stationary = jnp.concatenate([jnp.full(3, tuning.gps_error_sigma**2), tuning.scale_sigma**2])
    growth = stationary * (1.0 - factors[:5] ** 2)
    none = jnp.zeros((3, 3), dtype=P.dtype)
    Q = jnp.concatenate(
        [
            jnp.zeros((3, 12), dtype=P.dtype),
            jnp.concatenate([none, absolute, none, -burn], axis=1),
            jnp.zeros((3, 12), dtype=P.dtype),
            jnp.concatenate([none, -burn, none, relative], axis=1),
        ],
        axis=0,
    )
    Q = jnp.pad(Q, ((0, 7), (0, 7)))
    return P + Q + jnp.diag(jnp.pad(growth, (ORBITS, 2)))


def _burn_covariance(tuning: Navigation, delta_v_N: Vector, burn_delta_v: Scalar) -> Matrix:
    size = safe.norm(delta_v_N)
    along = safe.normalize(delta_v_N)
    projection = along[:, None] * along[None, :]
    identity = jnp.eye(3, dtype=delta_v_N.dtype)
    shape = tuning.burn_magnitude_sigma**2 * projection + tuning.burn_direction_sigma**2 * (identity - projection)
    return size * burn_delta_v * shape


@pytree
class BoxModel:
    """The box as predicted, linearised at some relative position.

    Attributes:
        predicted: (3,) tangents and log-size
        gradient: (3, 3) their derivative to the relative position in N
        variance: (3,) measurement noise
    """

    predicted: Array
    gradient: Array
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
    bearing = (
        (0.5 * tuning.edge_noise**2 + doubt_px**2) / focal_px**2
        + (tuning.center_noise / distance) ** 2
        + tuning.attitude_sigma**2
    )
    expected_px = focal_px * tuning.target_size / distance
    size = _ASPECT_FACTOR * (tuning.edge_noise / expected_px) ** 2
    return BoxModel(predicted=predicted, gradient=gradient, variance=jnp.stack([bearing, bearing, size]))


def update(
    tuning: Navigation,
    gated: bool,
    focal_px: Scalar,
    estimate: OrbitEstimate,
    track: BoxTrack,
    gps_N: Vector,
    q_KN: Float[Array, "4"],
    box: BoxMeasurement,
) -> tuple[OrbitEstimate, BoxTrack, Innovation]:
    """Estimate after GPS [m] and, if it passes the gate, the box; `q_KN` is the camera's attitude as known on board."""
    R_KN = quaternion.to_matrix(q_KN)
    measured = jnp.concatenate([box.tangent, box.log_size[None]])
    model = box_model(tuning, focal_px, R_KN, estimate.r_TS_N, box)
    slow = jnp.concatenate([estimate.bearing_bias, jnp.sum(estimate.scale, axis=0)[None]])
    residual = measured - model.predicted - slow
    variance = _innovation_variance(estimate.covariance, model)
    accepted = (
        _gate(tuning, focal_px, R_KN, estimate, track, box, residual, variance, model) if gated else box.present * 1.0
    )
    size_used = jnp.where(box.truncated, 0.0, accepted)

    point = _iterated_position(tuning, focal_px, R_KN, estimate, box, measured - slow)
    model = box_model(tuning, focal_px, R_KN, point, box)
    residual = measured - model.predicted - slow - apply(model.gradient, estimate.r_TS_N - point)
    rows = Rows(
        residual=jnp.concatenate([gps_N - estimate.r_SN_N - estimate.gps_error_N, residual]),
        jacobian=_jacobian(model),
        variance=jnp.concatenate([jnp.full(3, tuning.gps_noise**2), model.variance]),
        weight=jnp.concatenate([jnp.ones(3, dtype=residual.dtype), jnp.stack([accepted, accepted, size_used])]),
    )
    result = scalar_update.update(estimate.covariance, rows)
    is_accepted = accepted > 0.5
    is_rejected = box.present & ~is_accepted
    track, doubt = _remember(tuning, track, q_KN, box, is_rejected)
    corrected = _correct(estimate, result.deviation, _add_doubt(tuning, estimate.r_TS_N, result.covariance, doubt))
    innovation = Innovation(
        innovation=result.innovation,
        variance=result.innovation_variance,
        log_likelihood=result.log_likelihood,
        accepted=is_accepted,
        rejected=is_rejected,
    )
    return corrected, track, innovation


def _jacobian(model: BoxModel) -> Float[Array, "6 19"]:
    """Rows for GPS and box; constants are written out so that only the box's 3x3 part is data."""
    identity = jnp.eye(3, dtype=model.gradient.dtype)
    gps = jnp.concatenate([identity, jnp.zeros((3, 9)), identity, jnp.zeros((3, 4))], axis=1)
    scale = jnp.array([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0]], dtype=identity.dtype)
    bias = jnp.eye(3, 2, dtype=identity.dtype)
    box = jnp.concatenate([jnp.zeros((3, 6)), model.gradient, jnp.zeros((3, 6)), scale, bias], axis=1)
    return jnp.concatenate([gps, box], axis=0)


def _innovation_variance(P: Float[Array, "19 19"], model: BoxModel) -> Vector:
    """Variance of the box residuals before the update."""
    G = model.gradient
    own = jnp.sum(G * jnp.sum(G[:, None, :] * P[None, RELATIVE_POSITION, RELATIVE_POSITION], axis=2), axis=1)
    with_bias = jnp.sum(G[:2] * P[BEARING_BIAS, RELATIVE_POSITION], axis=1)
    scale_columns = P[15, RELATIVE_POSITION] + P[16, RELATIVE_POSITION]
    with_scale = jnp.sum(G[2] * scale_columns, axis=0)
    bias = jnp.stack([P[17, 17], P[18, 18]]) + 2.0 * with_bias
    scale = P[15, 15] + P[16, 16] + 2.0 * P[15, 16] + 2.0 * with_scale
    return own + jnp.concatenate([bias, scale[None]]) + model.variance


def _gate(
    tuning: Navigation,
    focal_px: Scalar,
    R_KN: Matrix,
    estimate: OrbitEstimate,
    track: BoxTrack,
    box: BoxMeasurement,
    residual: Vector,
    variance: Vector,
    model: BoxModel,
) -> Scalar:
    """1 if the box lies within the projected covariance and, while that is wide, the frame before agrees with it."""
    ratio = residual**2 / variance
    bearing = jnp.maximum(ratio[0], ratio[1])
    worst = jnp.where(box.truncated, bearing, jnp.maximum(bearing, ratio[2]))
    inside = safe.gate(tuning.gate_sigma**2 - worst, jnp.asarray(0.25, dtype=worst.dtype))
    wide = jnp.any(variance[:2] > (1.0 + tuning.confirm_above**2) * model.variance[:2], axis=0)
    confirmed = _agrees(tuning, focal_px, R_KN, track, box)
    r_K = apply(R_KN, estimate.r_TS_N)
    ahead = r_K[2] > _LEAST_DEPTH * safe.norm(r_K)
    return jnp.where(box.present & ahead & (confirmed | ~wide), inside, 0.0)


def _agrees(
    tuning: Navigation, focal_px: Scalar, R_KN: Matrix, track: BoxTrack, box: BoxMeasurement
) -> Bool[Array, ""]:
    """True if a box of the last few frames had nearly the same inertial direction."""
    before = apply(R_KN, track.direction_N)
    depth = jnp.where(before[2] > 0.1, before[2], 0.1)
    apart = jnp.max(jnp.abs(before[:2] / depth - box.tangent), axis=0)
    recent = track.age <= tuning.confirm_frames
    return recent & (apart * focal_px < tuning.confirm_tolerance * track.age) & (before[2] > 0.1)


def _iterated_position(
    tuning: Navigation,
    focal_px: Scalar,
    R_KN: Matrix,
    estimate: OrbitEstimate,
    box: BoxMeasurement,
    measured: Vector,
) -> Vector:
    """Relative position near the posterior, where the box is linearised (two Gauss-Newton steps on the bearing).

    A bearing far more certain than the prior must be linearised along the measured direction, or the squeezed
    covariance points the wrong way.
    """
    P = estimate.covariance[RELATIVE_POSITION, RELATIVE_POSITION]
    point = estimate.r_TS_N
    for _ in range(2):
        model = box_model(tuning, focal_px, R_KN, point, box)
        G = model.gradient[:2]
        residual = measured[:2] - model.predicted[:2] - apply_rows(G, estimate.r_TS_N - point)
        PG = jnp.sum(P[:, None, :] * G[None, :, :], axis=2)
        S = jnp.sum(G[:, :, None] * PG[None, :, :], axis=1)
        noise = model.variance[:2] + tuning.bearing_bias_sigma**2
        a, b, c = S[0, 0] + noise[0], S[0, 1], S[1, 1] + noise[1]
        solved = jnp.stack([c * residual[0] - b * residual[1], a * residual[1] - b * residual[0]]) / (a * c - b * b)
        point = estimate.r_TS_N + jnp.sum(PG * solved[None, :], axis=1)
    return point


def apply_rows(matrix: Float[Array, "m 3"], vector: Vector) -> Float[Array, " m"]:
    """Product of a matrix with three columns and a 3-vector."""
    return jnp.sum(matrix * vector[None, :], axis=1)


def _remember(
    tuning: Navigation,
    track: BoxTrack,
    q_KN: Float[Array, "4"],
    box: BoxMeasurement,
    rejected: Bool[Array, ""],
) -> tuple[BoxTrack, Bool[Array, ""]]:
    """Memory after a frame, and whether so many boxes were rejected that the filter should doubt itself."""
    ray_K = jnp.concatenate([box.tangent, jnp.ones_like(box.tangent[:1])])
    direction_N = quaternion.rotate(quaternion.conjugate(q_KN), safe.normalize(ray_K))
    count = jnp.where(rejected, track.rejections + 1.0, 0.0)
    doubt = count >= tuning.rejections_before_recovery
    return BoxTrack(
        direction_N=jnp.where(box.present, direction_N, track.direction_N),
        age=jnp.where(box.present, 1.0, track.age + 1.0),
        rejections=jnp.where(doubt, 0.0, count),
    ), doubt


def _add_doubt(
    tuning: Navigation, r_TS_N: Vector, P: Float[Array, "19 19"], doubt: Bool[Array, ""]
) -> Float[Array, "19 19"]:
    """Covariance with the relative state's uncertainty raised when the filter doubts itself, so that it can find back."""
    square = jnp.sum(r_TS_N * r_TS_N, axis=0)
    position = tuning.recovery_position_sigma**2 * square
    velocity = tuning.recovery_velocity_sigma**2
    none = jnp.zeros(3, dtype=P.dtype)
    added = jnp.concatenate([none, none, none + position, none + velocity, jnp.zeros(7, dtype=P.dtype)])
    return P + jnp.diag(jnp.where(doubt, added, 0.0))


def _correct(
    estimate: OrbitEstimate, deviation: Float[Array, "19"], covariance: Float[Array, "19 19"]
) -> OrbitEstimate:
    return OrbitEstimate(
        r_SN_N=estimate.r_SN_N + deviation[POSITION],
        v_SN_N=estimate.v_SN_N + deviation[VELOCITY],
        r_TS_N=estimate.r_TS_N + deviation[RELATIVE_POSITION],
        v_TS_N=estimate.v_TS_N + deviation[RELATIVE_VELOCITY],
        gps_error_N=estimate.gps_error_N + deviation[GPS_ERROR],
        scale=estimate.scale + deviation[SCALE],
        bearing_bias=estimate.bearing_bias + deviation[BEARING_BIAS],
        covariance=covariance,
    )
