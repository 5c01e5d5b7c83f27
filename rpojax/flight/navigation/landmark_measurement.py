"""Landmarks of the target in a picture as measurement of its position and attitude, and the first pose from them.

All landmarks of a picture are put together to at most eight rows, by the Cholesky factor of their information on
position, attitude error and bearing: the rows carry what all of them do, and the filter takes eight in place of forty.
"""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.batching.jax_programs import any_of_batch
from rpojax.core import quaternion
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.numerics.short_scan import short_scan
from rpojax.core.numerics.small_systems import cholesky_rows
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import apply, product
from rpojax.flight.navigation import perspective_n_point, target_attitude_ekf
from rpojax.flight.navigation.believed_sensor import SensorView
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget, cross_matrix

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]

ROWS = 8
"""Rows of a picture: three of position, three of the attitude error, two of the bearing."""
_PARTS = ("position", "attitude", "bearing_bias")
_FEWEST = 6
"""Landmarks from which a first pose is believed."""
_SLACK = 1e-9
"""Information that is added to each part, as a share of its own, so that a direction without any has a pivot."""
_FIT = 9.0
"""Mean square of the residuals of a first pose, over that of the noise, up to which it is believed."""
_PLACE_GATE = 5.0
"""Sigmas of the filter within which a first pose has to put the target, along each axis."""
_NEAREST = 0.05
"""Depth from which on a landmark is in front of the camera [m]."""


@pytree
class LandmarkView:
    """Landmarks that a camera has found.

    Attributes:
        tangents: (n, 2) right and down of the boresight, of any value where there is none
        variance: (n,) of each tangent
        present: (n,) bool
        q_KN: (4,) attitude of the camera by the attitude filter
        attitude_variance: () of that attitude across the boresight, white from picture to picture [rad^2]
    """

    tangents: Array
    variance: Array
    present: Array
    q_KN: Array
    attitude_variance: Array


def picture(beliefs: Mapping[str, Array], view: SensorView, measured: Mapping[str, Array]) -> LandmarkView:
    """Landmarks of a picture as measured, with what flight software believes of them."""
    assert view.vehicle is not None
    tangents = jnp.stack([measured["landmarks_right_tangent"], measured["landmarks_down_tangent"]], axis=1)
    present = jnp.all(jnp.isfinite(tangents), axis=1)
    sigma = beliefs["believed_noise"] / view.vehicle.focal_px
    return LandmarkView(
        tangents=jnp.where(present[:, None], tangents, 0.0),
        variance=jnp.broadcast_to(sigma**2, present.shape),
        present=present,
        q_KN=quaternion.multiply(quaternion.normalize(view.vehicle.camera_mounting), view.q_BN),
        attitude_variance=view.tuning.attitude_sigma**2,
    )


def rows(
    tuning: OrbitFilterTuning, target: BelievedTarget, estimate: RelativeEstimate, view: LandmarkView
) -> MeasurementRows:
    """Rows (8,) of the landmarks that pass their gates, for an estimate with the target's attitude."""
    assert estimate.target is not None
    pose = _Pose.of(estimate, view)
    layout, body_offset = estimate.layout, estimate.slow["body_offset"]
    numbers = jnp.array([number for name in _PARTS for number in layout.places(name)])
    shared = estimate.covariance[numbers][:, numbers]

    def add(sums: tuple[Array, Array], landmark: tuple[Array, ...]) -> tuple[tuple[Array, Array], None]:
        place_T, measured, variance, present = landmark
        expected, jacobian = _linearised(pose, place_T + body_offset)
        residual = jnp.where(present, measured, 0.0) - expected
        noise = variance + view.attitude_variance
        used = present & estimate.target.known & _is_inside(tuning, shared, noise, residual, jacobian)
        weighted = jacobian * jnp.where(used, 1.0 / variance, 0.0)
        added = product(weighted.T, jacobian), jnp.sum(weighted * residual[:, None], axis=0)
        return (sums[0] + added[0], sums[1] + added[1]), None

    nothing = jnp.zeros((ROWS, ROWS), dtype=shared.dtype), jnp.zeros(ROWS, dtype=shared.dtype)
    each = (target.landmarks, view.tangents, view.variance, view.present)
    information, evidence = short_scan(add, nothing, each)
    information, evidence = _without_common_error(information, evidence, view.attitude_variance)
    factor, values, exists = _factorised(information, evidence)
    by_part = dict(zip(_PARTS, (factor[:, :3], factor[:, 3:6], factor[:, 6:]), strict=True))
    # A centre of mass that is elsewhere in the body moves all landmarks alike.
    return MeasurementRows(
        residual=values,
        jacobian=layout.rows(**by_part, body_offset=product(factor[:, :3], pose.R_NT)),
        variance=jnp.ones_like(values),
        weight=jnp.where(exists, 1.0, 0.0),
    )


@pytree
class _Pose:
    """Estimated pose of the target before the camera.

    Attributes:
        R_KN: (3, 3)
        R_NT: (3, 3)
        R_KT: (3, 3)
        center_K: (3,) centre of mass [m]
        bearing_bias: (2,)
    """

    R_KN: Array
    R_NT: Array
    R_KT: Array
    center_K: Array
    bearing_bias: Array

    @classmethod
    def of(cls, estimate: RelativeEstimate, view: LandmarkView) -> "_Pose":
        """Pose of an estimate in a picture."""
        assert estimate.target is not None
        R_KN = quaternion.to_matrix(view.q_KN)
        R_NT = quaternion.to_matrix(quaternion.conjugate(target_attitude_ekf.attitude(estimate.target, estimate.slow)))
        return cls(
            R_KN=R_KN,
            R_NT=R_NT,
            R_KT=product(R_KN, R_NT),
            center_K=jnp.sum(R_KN * estimate.r_TS_N[None, :], axis=1),
            bearing_bias=estimate.slow["bearing_bias"],
        )


def _linearised(pose: _Pose, place_T: Vector) -> tuple[Float[Array, "2"], Float[Array, "2 8"]]:
    """Expected tangents of a landmark, and their derivatives to position, attitude error and bearing."""
    place_K = apply(pose.R_KT, place_T) + pose.center_K
    depth = jnp.maximum(place_K[2], _NEAREST)
    tangents, one, none = place_K[:2] / depth, 1.0 / depth, jnp.zeros_like(depth)
    to_place = jnp.stack(
        [jnp.stack([one, none, -tangents[0] * one]), jnp.stack([none, one, -tangents[1] * one])],
    )
    # v_N = R_NT (l + l x a): the error turns the body, and so the landmarks the other way in its own axes.
    parts = (
        product(to_place, pose.R_KN),
        product(product(to_place, pose.R_KT), cross_matrix(place_T)),
        jnp.eye(2, dtype=depth.dtype),
    )
    return tangents + pose.bearing_bias, jnp.concatenate(parts, axis=1)


def _is_inside(
    tuning: OrbitFilterTuning, shared: Float[Array, "8 8"], noise: Scalar, residual: Array, jacobian: Array
) -> Bool[Array, ""]:
    """Whether a landmark is where the filter expects it, within `gate_sigma`."""
    S = product(product(jacobian, shared), jacobian.T)
    a, b, c = S[0, 0] + noise, S[0, 1], S[1, 1] + noise
    x, y = residual[0], residual[1]
    return c * x * x - 2.0 * b * x * y + a * y * y < tuning.gate_sigma**2 * (a * c - b * b)


def _without_common_error(
    information: Float[Array, "8 8"], evidence: Float[Array, " 8"], variance: Scalar
) -> tuple[Float[Array, "8 8"], Float[Array, " 8"]]:
    """The same without what a common error of the bearing in this picture, of that variance, does not let be known."""
    columns = information[:, 6:]
    a, b, c = information[6, 6] + 1.0 / variance, information[6, 7], information[7, 7] + 1.0 / variance
    determinant = a * c - b * b
    inverse = jnp.stack([jnp.stack([c, -b]), jnp.stack([-b, a])]) / determinant
    gain = product(columns, inverse)
    return information - product(gain, columns.T), evidence - jnp.sum(gain * evidence[6:][None, :], axis=1)


def _factorised(information: Float[Array, "8 8"], evidence: Float[Array, " 8"]) -> tuple[Array, Array, Array]:
    """Rows (8, 8) of unit variance with that information, their values (8,), and whether there is each (8,)."""
    diagonal = jnp.stack([information[i, i] for i in range(ROWS)])
    lower = cholesky_rows(information + _SLACK * jnp.diag(diagonal))
    zero, values, found = jnp.zeros_like(evidence[0]), [], []
    for i in range(ROWS):
        rest = evidence[i]
        for k in range(i):
            rest = rest - lower[i][k] * values[k]
        values.append(rest * lower[i][i])
    for k in range(ROWS):
        inverse = lower[k][k]
        pivot = jnp.where(inverse > 0.0, 1.0 / jnp.where(inverse > 0.0, inverse, 1.0), 0.0)
        found.append(jnp.stack([zero] * k + [pivot] + [lower[i][k] for i in range(k + 1, ROWS)]))
    return jnp.stack(found), jnp.stack(values), jnp.stack([lower[k][k] > 0.0 for k in range(ROWS)])


def acquired(
    tuning: OrbitFilterTuning, target: BelievedTarget, estimate: RelativeEstimate, view: LandmarkView
) -> RelativeEstimate:
    """Estimate with a first pose where the attitude is not known and enough landmarks are seen."""
    assert estimate.target is not None
    seen = jnp.sum(view.present, axis=0, dtype=jnp.int32)
    wanted = ~estimate.target.known & (seen >= _FEWEST)

    def found(estimate: RelativeEstimate) -> RelativeEstimate:
        return _with_first_pose(tuning, target, estimate, view, wanted, seen)

    return jax.lax.cond(any_of_batch(wanted), found, lambda estimate: estimate, estimate)


def _with_first_pose(
    tuning: OrbitFilterTuning,
    target: BelievedTarget,
    estimate: RelativeEstimate,
    view: LandmarkView,
    wanted: Bool[Array, ""],
    seen: Array,
) -> RelativeEstimate:
    """Estimate with the best pose of a picture where it is `wanted`, explains the picture and is where the target is."""
    assert estimate.target is not None
    poses = perspective_n_point.solve_pose(
        target.landmarks, view.tangents, jnp.where(view.present, 1.0 / view.variance, 0.0)
    )
    R_KT, q_KT = quaternion.to_matrix(poses.q_KT[0]), poses.q_KT[0]
    expected_K = quaternion.rotate(view.q_KN, estimate.r_TS_N)
    R_KN = quaternion.to_matrix(view.q_KN)
    P_K = product(product(R_KN, estimate.position_covariance), R_KN.T) + poses.covariance[0, 3:, 3:]
    off, variance = poses.r_TK_K[0] - expected_K, jnp.stack([P_K[i, i] for i in range(3)])
    explains = poses.cost[0] < _FIT * (2.0 * seen - 6.0)
    there = jnp.all(off * off < _PLACE_GATE**2 * variance, axis=0)
    take = wanted & poses.exists[0] & poses.enough & explains & there
    q_TN = quaternion.multiply(quaternion.conjugate(q_KT), view.q_KN)
    angle = product(product(R_KT.T, poses.covariance[0, :3, :3]), R_KT)
    angle = angle + view.attitude_variance * jnp.eye(3, dtype=angle.dtype)
    reference = estimate.target
    reference = replace(
        reference,
        q_TN=jnp.where(take, quaternion.normalize(q_TN), reference.q_TN),
        known=reference.known | take,
        unexplained_s=jnp.where(take, 0.0, reference.unexplained_s),
    )
    slow = {**estimate.slow}
    for name in ("attitude", "rate"):
        slow[name] = jnp.where(take, 0.0, slow[name])
    fresh = _uncorrelated(tuning, estimate, angle)
    return replace(estimate, target=reference, slow=slow, covariance=jnp.where(take, fresh, estimate.covariance))


def _uncorrelated(tuning: OrbitFilterTuning, estimate: RelativeEstimate, angle: Array) -> Float[Array, "n n"]:
    """Covariance with a new attitude error and rate, of which nothing else knows."""
    layout, P = estimate.layout, estimate.covariance
    for name, block in (
        ("attitude", angle),
        ("rate", tuning.tumble_sigma**2 * jnp.eye(3, dtype=P.dtype)),
    ):
        place = layout[name]
        P = P.at[place].set(0.0).at[:, place].set(0.0).at[place, place].set(block)
    return P
