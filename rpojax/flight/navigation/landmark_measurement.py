"""Landmarks of the target in a picture as measurement of its position and attitude, and the first pose from them.

All landmarks of a picture are put together to at most eight rows, by the Cholesky factor of their information on
position, attitude error and bearing: the rows carry what all of them do, and the filter takes eight in place of forty.
"""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from rpojax.batching.jax_programs import any_of_batch
from rpojax.core import quaternion
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.short_scan import short_scan
from rpojax.core.pytree import pytree, replace, select
from rpojax.core.vectors import apply, product
from rpojax.flight.navigation import (
    perspective_n_point,
    relative_filter_state,
    symmetric_attitudes,
    target_attitude_ekf,
)
from rpojax.flight.navigation.believed_sensor import SensorView
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget, cross_matrix

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]

ROWS = 8
"""Rows of a picture: three of position, three of the attitude error, two of the bearing."""
_PARTS = ("position", "attitude", "bearing_bias")
_SHARE = 0.5
"""Share of the landmarks of a picture that have to be where the filter expects them: the joint gate."""
FEWEST = 6
"""Landmarks from which a first pose is believed."""
_SLACK = 1e-9
"""Information that is added to each part, as a share of its own, so that a direction without any has a pivot."""
_FIT = 4.0
"""Mean square of the residuals of a first pose, over that of the noise, up to which it is believed."""
_AMBIGUOUS = 25.0
"""Difference of the squared residuals of two poses over the noise, up to which either may be right."""
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

    @property
    def seen(self) -> Array:
        """Number of landmarks () that were found, int32."""
        return jnp.sum(self.present, axis=0, dtype=jnp.int32)


def picture(beliefs: Mapping[str, Array], view: SensorView, measured: Mapping[str, Array]) -> LandmarkView:
    """Landmarks of a picture as measured, with what flight software believes of them."""
    assert view.vehicle is not None
    tangents = jnp.stack([measured["landmarks_right_tangent"], measured["landmarks_down_tangent"]], axis=1)
    present = jnp.all(jnp.isfinite(tangents), axis=1)
    # Before the product: the derivative of one with what is no number is none.
    sigma = beliefs["believed_noise_factor"] * jnp.where(present, measured["landmarks_sigma_tangent"], 1.0)
    return LandmarkView(
        tangents=jnp.where(present[:, None], tangents, 0.0),
        variance=sigma**2,
        present=present,
        q_KN=quaternion.multiply(quaternion.normalize(view.vehicle.camera_mounting), view.q_BN),
        attitude_variance=view.tuning.attitude_sigma**2,
    )


def count(measured: Mapping[str, Array]) -> Int[Array, ""]:
    """Number of landmarks that were found in a picture."""
    return jnp.sum(jnp.isfinite(measured["landmarks_right_tangent"]), axis=0, dtype=jnp.int32)


def shows_pose(measured: Mapping[str, Array]) -> Bool[Array, ""]:
    """Whether a picture shows enough landmarks for a pose."""
    return count(measured) >= FEWEST


def rows(
    tuning: OrbitFilterTuning, target: BelievedTarget, estimate: RelativeEstimate, view: LandmarkView
) -> MeasurementRows:
    """Rows (8,) of the landmarks that pass their gates, for an estimate with the target's attitude."""
    assert estimate.target is not None
    known, pose = estimate.target.known, _Pose.of(estimate, view)
    layout, body_offset = estimate.layout, estimate.slow["body_offset"]
    lasting = _lasting_errors(estimate, pose)
    shared = _shared_covariance(estimate, pose, lasting)

    def add(sums: tuple[Array, ...], landmark: tuple[Array, ...]) -> tuple[tuple[Array, ...], None]:
        place_T, measured, variance, present = landmark
        expected, jacobian = _linearised(pose, place_T + body_offset)
        residual = jnp.where(present, measured, 0.0) - expected
        noise = variance + view.attitude_variance
        used = present & known & _is_inside(tuning, shared, noise, residual, jacobian)
        weighted = jacobian * jnp.where(used, 1.0 / variance, 0.0)
        added = product(weighted.T, jacobian), jnp.sum(weighted * residual[:, None], axis=0)
        return (sums[0] + added[0], sums[1] + added[1], sums[2] + jnp.where(used, 1.0, 0.0)), None

    none = jnp.zeros_like(shared[0, 0])
    nothing = jnp.zeros((ROWS, ROWS), dtype=shared.dtype), jnp.zeros(ROWS, dtype=shared.dtype), none
    each = (target.landmarks, view.tangents, view.variance, view.present)
    information, evidence, count = short_scan(add, nothing, each)
    agree = count >= _SHARE * jnp.sum(jnp.where(view.present, 1.0, 0.0), axis=0)
    information, evidence = _without_common_error(information, evidence, view.attitude_variance)
    factor, values, exists = _factorised(information, evidence)
    parts = factor[:, :3], factor[:, 3:6], factor[:, 6:]
    by_part = dict(zip(_PARTS, parts, strict=True))
    by_error = {name: product(parts[acts_as], effect) for name, (acts_as, effect) in lasting.items()}
    # A centre of mass that is elsewhere in the body moves all landmarks alike.
    return MeasurementRows(
        residual=values,
        jacobian=layout.rows(**by_part, body_offset=product(parts[0], pose.R_NT), **by_error),
        variance=jnp.ones_like(values),
        weight=jnp.where(exists & agree, 1.0, 0.0),
    )


def _shared_covariance(estimate: RelativeEstimate, pose: "_Pose", lasting: "_LastingErrors") -> Float[Array, "8 8"]:
    """Covariance of what the rows are of: place of the landmarks' frame, attitude error and bearing."""
    layout = estimate.layout
    position, attitude, bias = (layout[name] for name in _PARTS)
    offset = layout["body_offset"]

    def shown(P: Array) -> Array:
        parts = [P[position] + product(pose.R_NT, P[offset]), P[attitude]]
        for name, (acts_as, effect) in lasting.items():
            parts[acts_as] = parts[acts_as] + product(effect, P[layout[name]])
        return jnp.concatenate([*parts, P[bias]])

    return shown(shown(estimate.covariance).T)


_LastingErrors = dict[str, tuple[int, Array]]
"""Lasting errors of a landmark network by name: number of the part of the rows as which each acts, and its effect."""


def _lasting_errors(estimate: RelativeEstimate, pose: "_Pose") -> _LastingErrors:
    """Effects (3, 3) of a unit of each lasting error of a landmark network; none of another source of landmarks."""
    if "network_turn" not in estimate.layout:
        return {}
    distance = gradient_safe.norm(estimate.r_TS_N)
    return {
        "network_place": (_PARTS.index("position"), distance * pose.R_KN.T),
        "network_turn": (_PARTS.index("attitude"), pose.R_KT.T),
    }


@pytree
class _Pose:
    """Estimated pose of the target before the camera, as the landmarks show it.

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
        R_KT, center_K = product(R_KN, R_NT), jnp.sum(R_KN * estimate.r_TS_N[None, :], axis=1)
        if "network_turn" in estimate.slow:
            R_KT = product(quaternion.to_matrix(quaternion.exp(-estimate.slow["network_turn"])), R_KT)
            R_NT = product(R_KN.T, R_KT)
            center_K = center_K + gradient_safe.norm(estimate.r_TS_N) * estimate.slow["network_place"]
        return cls(
            R_KN=R_KN,
            R_NT=R_NT,
            R_KT=R_KT,
            center_K=center_K,
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


def expected(
    target: BelievedTarget, estimate: RelativeEstimate, view: LandmarkView
) -> tuple[Float[Array, "n 2"], Float[Array, "n 2 2"]]:
    """Tangents of all landmarks that an estimate with the target's attitude expects, and their covariance by it."""
    pose = _Pose.of(estimate, view)
    shared = _shared_covariance(estimate, pose, _lasting_errors(estimate, pose))

    def of_one(place_T: Vector) -> tuple[Array, Array]:
        tangents, jacobian = _linearised(pose, place_T)
        return tangents, product(product(jacobian, shared), jacobian.T)

    return jax.vmap(of_one)(target.landmarks + estimate.slow["body_offset"][None, :])


def _is_inside(
    tuning: OrbitFilterTuning, shared: Float[Array, "8 8"], noise: Scalar, residual: Array, jacobian: Array
) -> Bool[Array, ""]:
    """Whether a landmark is where the filter expects it, within `gate_sigma`."""
    square, determinant = squared_residual(product(product(jacobian, shared), jacobian.T), noise, residual)
    return square < tuning.gate_sigma**2 * determinant


def squared_residual(spread: Float[Array, "2 2"], noise: Scalar, residual: Float[Array, "2"]) -> tuple[Scalar, Scalar]:
    """Squared residual in sigmas times the determinant of its covariance, and that determinant."""
    a, b, c = spread[0, 0] + noise, spread[0, 1], spread[1, 1] + noise
    x, y = residual[0], residual[1]
    return c * x * x - 2.0 * b * x * y + a * y * y, a * c - b * b


def _without_common_error(
    information: Float[Array, "8 8"], evidence: Float[Array, " 8"], variance: Scalar
) -> tuple[Float[Array, "8 8"], Float[Array, " 8"]]:
    """The same without what a common error of the bearing in this picture, of that variance, does not let be known."""
    # Multiplied by the variance, which may be 0.
    columns = information[:, 6:]
    a, b, c = 1.0 + variance * columns[6, 0], variance * columns[6, 1], 1.0 + variance * columns[7, 1]
    inverse = jnp.stack([jnp.stack([c, -b]), jnp.stack([-b, a])]) / (a * c - b * b)
    gain = variance * product(columns, inverse)
    return information - product(gain, columns.T), evidence - jnp.sum(gain * evidence[6:][None, :], axis=1)


def _factorised(information: Float[Array, "8 8"], evidence: Float[Array, " 8"]) -> tuple[Array, Array, Array]:
    """Rows (8, 8) of unit variance with that information, their values (8,), and whether there is each (8,).

    They are those of the Cholesky factor, one after the other.
    """

    def eliminate(rest: tuple[Array, Array], index: Array) -> tuple[tuple[Array, Array], tuple[Array, Array, Array]]:
        matrix, values = rest
        pivot, exists = matrix[index, index], matrix[index, index] > 0.0
        inverse = jnp.where(exists, 1.0 / jnp.sqrt(jnp.where(exists, pivot, 1.0)), 0.0)
        row, value = inverse * matrix[index], inverse * values[index]
        return (matrix - row[:, None] * row[None, :], values - row * value), (row, value, exists)

    slack = _SLACK * jnp.diag(jnp.diagonal(information))
    return jax.lax.scan(eliminate, (information + slack, evidence), jnp.arange(ROWS))[1]


def contradicts(view: LandmarkView, used: Bool[Array, ""]) -> Bool[Array, ""]:
    """Whether a picture shows enough landmarks for a pose, and none of it was `used`."""
    return ~used & (view.seen >= FEWEST)


def acquired(
    tuning: OrbitFilterTuning, target: BelievedTarget, estimate: RelativeEstimate, view: LandmarkView
) -> RelativeEstimate:
    """Estimate with a first pose where the attitude is not known and enough landmarks are seen."""
    assert estimate.target is not None
    wanted = ~estimate.target.known & (view.seen >= FEWEST)

    def found(estimate: RelativeEstimate) -> RelativeEstimate:
        return _with_first_pose(tuning, target, estimate, view, wanted)

    return jax.lax.cond(any_of_batch(wanted), found, lambda estimate: estimate, estimate)


def _with_first_pose(
    tuning: OrbitFilterTuning,
    target: BelievedTarget,
    estimate: RelativeEstimate,
    view: LandmarkView,
    wanted: Bool[Array, ""],
) -> RelativeEstimate:
    """Estimate with the best pose where it is `wanted`, explains the picture and puts the target where it is."""
    assert estimate.target is not None
    poses = perspective_n_point.solve_pose(
        target.landmarks + estimate.slow["body_offset"][None, :],
        view.tangents - estimate.slow["bearing_bias"][None, :],
        jnp.where(view.present, 1.0 / view.variance, 0.0),
    )
    explains = poses.cost[0] < _FIT * (2.0 * view.seen.astype(view.variance.dtype) - 6.0)
    errors = _PoseErrors.of(estimate, view, poses)
    place = apply(quaternion.to_matrix(quaternion.conjugate(view.q_KN)), poses.r_TK_K[0])
    variance, before = jnp.diagonal(errors.covariance)[3:], jnp.diagonal(estimate.position_covariance)
    off = place - estimate.r_TS_N
    there = jnp.all(off * off < _PLACE_GATE**2 * (variance + before), axis=0)
    # Of two poses that explain a picture about as well, another picture decides.
    alone = ~poses.exists[1] | (poses.cost[1] - poses.cost[0] > _AMBIGUOUS)
    # A pivot that is none leaves a variance of zero.
    determined = jnp.all(jnp.diagonal(poses.covariance[0]) > 0.0, axis=0)
    take = wanted & poses.exists[0] & poses.enough & determined & explains & alone & there
    is_better = take & (jnp.sum(variance, axis=0) < jnp.sum(before, axis=0))
    q_TN = quaternion.multiply(quaternion.conjugate(poses.q_KT[0]), view.q_KN)
    reference = estimate.target
    reference = replace(
        reference,
        q_TN=jnp.where(take, quaternion.normalize(q_TN), reference.q_TN),
        known=reference.known | take,
        unexplained_s=jnp.where(take, 0.0, reference.unexplained_s),
        votes=symmetric_attitudes.begun(reference.votes, take),
    )
    anew = relative_filter_state.reset_to_prior(tuning, estimate, ("attitude", "rate"), take)
    with_attitude = replace(anew, covariance=_with_attitude(anew, errors))
    at_place = replace(with_attitude, r_TS_N=place, covariance=_with_place(with_attitude, errors))
    moved = select(take, select(is_better, at_place, with_attitude), anew)
    return replace(moved, target=reference)


@pytree
class _PoseErrors:
    """Errors of the attitude in T and the place in N [m] by a pose.

    A pose has the errors of the bearing and of the landmarks' offset in it. Those of the bearing turn the target about
    the camera.

    Attributes:
        covariance: (6, 6)
        with_state: (6, n) covariance with the errors of the state
    """

    covariance: Array
    with_state: Array

    @classmethod
    def of(
        cls, estimate: RelativeEstimate, view: LandmarkView, poses: perspective_n_point.PoseHypotheses
    ) -> "_PoseErrors":
        """Errors of the best hypothesis."""
        layout, (x, y, z) = estimate.layout, poses.r_TK_K[0]
        R_KT, R_NK = quaternion.to_matrix(poses.q_KT[0]), quaternion.to_matrix(quaternion.conjugate(view.q_KN))
        one, none = jnp.ones_like(z), jnp.zeros_like(R_KT)
        across = jnp.stack([jnp.stack([none[0, 0], -one]), jnp.stack([one, none[0, 0]]), none[0, :2]])
        shift = jnp.stack([jnp.stack([z, none[0, 0]]), jnp.stack([none[0, 0], z]), jnp.stack([-x, -y])])
        by_bearing = jnp.concatenate([product(R_KT.T, across), -product(R_NK, shift)])
        effects = jnp.concatenate([by_bearing, jnp.concatenate([none, -product(R_NK, R_KT)])], axis=1)
        names = ["bearing_bias", "body_offset"]
        if "network_turn" in layout:
            # The pose is turned and moved by them; what is to be added to it is the opposite.
            by_place = -gradient_safe.norm(poses.r_TK_K[0]) * R_NK
            by_network = jnp.concatenate(
                [jnp.concatenate([none, -R_KT.T], axis=1), jnp.concatenate([by_place, none], axis=1)]
            )
            effects, names = jnp.concatenate([effects, by_network], axis=1), [*names, "network_place", "network_turn"]
        numbers = jnp.array([place for name in names for place in layout.places(name)])
        with_state = product(effects, estimate.covariance[numbers])
        # An error of the attitude in T turns the other way in the camera.
        axes = jnp.concatenate([jnp.concatenate([-R_KT.T, none], axis=1), jnp.concatenate([none, R_NK], axis=1)])
        alone = product(product(axes, poses.covariance[0]), axes.T)
        roll = jnp.concatenate([R_KT[2], none[0]])
        white = product(by_bearing, by_bearing.T) + roll[:, None] * roll[None, :]
        shared = product(with_state[:, numbers], effects.T)
        return cls(covariance=alone + shared + view.attitude_variance * white, with_state=with_state)


def _with_attitude(estimate: RelativeEstimate, errors: _PoseErrors) -> Float[Array, "n n"]:
    """Covariance with the attitude error of a pose, for an estimate whose rate nothing else knows."""
    layout, P = estimate.layout, estimate.covariance
    attitude, rate = layout["attitude"], layout["rate"]
    rows = errors.with_state[:3].at[:, attitude].set(errors.covariance[:3, :3]).at[:, rate].set(0.0)
    return P.at[attitude].set(rows).at[:, attitude].set(rows.T)


def _with_place(estimate: RelativeEstimate, errors: _PoseErrors) -> Float[Array, "n n"]:
    """Covariance with the place of a pose whose attitude it has."""
    layout, P = estimate.layout, estimate.covariance
    position, attitude, rate = layout["position"], layout["attitude"], layout["rate"]
    rows = errors.with_state[3:].at[:, position].set(errors.covariance[3:, 3:])
    rows = rows.at[:, attitude].set(errors.covariance[3:, :3]).at[:, rate].set(0.0)
    return P.at[position].set(rows).at[:, position].set(rows.T)
