"""Pose of a target from the image coordinates of its landmarks, without a guess: several hypotheses, best first.

The squares of the distances of landmarks from their lines of sight, each with the best position for an attitude, add up
to a quadratic form in the nine elements of the rotation matrix (Terzakis and Lourakis, A Consistently Fast and Globally
Optimal Solution to the Perspective-n-Point Problem, ECCV 2020). Its minima over rotations are found from starts that
cover all of them, by steps whose cost does not depend on the number of landmarks. The deepest become hypotheses: each
is refined to the least squares of the image coordinates. A flat target has two that are nearly alike.
"""

from typing import Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.short_scan import short_scan
from rpojax.core.numerics.small_systems import inverse_positive_definite, solve_positive_definite
from rpojax.core.pytree import pytree
from rpojax.core.vectors import product

FEWEST: Final = 4
"""Landmarks that a pose needs: of three there are up to four poses without any residual."""
HYPOTHESES: Final = 4
_START_COUNT: Final = 24
_DESCENT_STEPS: Final = 8
_REFINING_STEPS: Final = 10
_FINAL_STEPS: Final = 3
"""Undamped steps at the end of refining: those that derivatives see."""
_LARGEST_TURN: Final = 0.6
"""Of one step of the descent [rad]."""
_DESCENT_DAMPING: Final = 1e-2
"""As a share of the mean curvature."""
_FIRST_DAMPING: Final = 1e-3
"""Of refining, as a share of each diagonal element of the information."""
_DAMPING_CHANGE: Final = 10.0
_LARGEST_GAIN: Final = 1e-3
"""Of the cost in one more step, beyond which a hypothesis is no minimum, but on its way to another one."""
_APART: Final = 0.1
"""Angle [rad] between minima of the descent that are two hypotheses."""
_SAME_TURN: Final = 1e-3
"""Angle [rad] between refined hypotheses that are one."""
_LEAST_DEPTH: Final = 1e-3
"""Depth in the camera [m] below which a landmark counts as there."""


def _spread_rotations(count: int) -> np.ndarray:
    """Unit quaternions (4, count) spread evenly over all rotations.

    Alexa, Super-Fibonacci Spirals: Fast, Low-Discrepancy Sampling of SO(3), CVPR 2022.
    """
    number = np.arange(count) + 0.5
    near, far = np.sqrt(number / count), np.sqrt(1.0 - number / count)
    first, second = 2.0 * np.pi * number / np.sqrt(2.0), 2.0 * np.pi * number / 1.533751168755204288118041
    return np.stack([near * np.sin(first), near * np.cos(first), far * np.sin(second), far * np.cos(second)])


_STARTS: Final = _spread_rotations(_START_COUNT)


@pytree
class PoseHypotheses:
    """Poses that explain what a camera sees of landmarks, the best one first.

    A landmark at p in T is at `rotate(q_KT, p) + r_TK_K` in camera axes. The error of a pose is a small turn `a` in
    camera axes [rad], so that `q_true = exp(a) q_KT`, and a shift [m].

    Attributes:
        q_KT: (k, 4) attitude of the target in the camera, of the two quaternions that with a scalar part above zero
        r_TK_K: (k, 3) position of the target's origin from the camera [m]
        cost: (k,) sum of the weighted squares of residuals, infinite where there is no hypothesis
        information: (k, 6, 6) on attitude and position, that of the weights
        covariance: (k, 6, 6) its inverse
        exists: (k,) bool, whether it is a minimum in front of the camera, unlike all before it
        enough: () bool, whether landmarks are as many as a pose needs
    """

    q_KT: Array
    r_TK_K: Array
    cost: Array
    information: Array
    covariance: Array
    exists: Array
    enough: Array


@pytree
class _Poses:
    """Poses side by side, and their least squares.

    Attributes:
        quaternion: (4, k) as `q_KT`
        position: (3, k) as `r_TK_K`
        cost: (k,)
        information: (6, 6, k)
        slope: (6, k) half the derivative of the cost
    """

    quaternion: Array
    position: Array
    cost: Array
    information: Array
    slope: Array


@pytree
class _View:
    """What is seen: landmarks (3, n) [m], image coordinates (2, n), weights (n,)."""

    landmarks: Array
    image: Array
    weights: Array


def solve_pose(
    landmarks_T: Float[Array, "n 3"], image: Float[Array, "n 2"], weights: Float[Array, " n"]
) -> PoseHypotheses:
    """Poses of a target from image coordinates (x / z, y / z) of its landmarks [m], all seen by a camera at K.

    Weights are one over the variance of a coordinate, 0 of landmarks that are not seen, whose coordinates are of no
    effect. Derivatives of poses to coordinates, weights and landmarks are those of the least squares; the choice and
    order of the hypotheses have none.
    """
    seen = weights > 0.0
    view = _View(
        landmarks=landmarks_T.T, image=jnp.where(seen[:, None], image, 0.0).T, weights=jnp.where(seen, weights, 0.0)
    )
    fixed = jax.lax.stop_gradient(view)
    found = _refined(fixed, *_deepest_minima(fixed))
    poses = _differentiable(view, found.quaternion, found.position)
    return _sorted(view, poses, jnp.sum(seen, dtype=jnp.int32) >= FEWEST)


def _deepest_minima(view: _View) -> tuple[Array, Array]:
    """Attitudes (4, k) and positions (3, k) of the deepest minima of the quadratic form, in front of the camera."""
    form, to_position, middle = _quadratic_form(view)
    starts = jnp.asarray(_STARTS, dtype=form.dtype)
    # Behind the camera a target looks as one before it that is turned by half a turn about the boresight.
    behind = _depth(_to_matrices(starts), to_position, middle) < 0.0
    turned = jnp.stack([-starts[3], -starts[2], starts[1], starts[0]])
    attitudes = _descended(form, jnp.where(behind, turned, starts))
    rotations = _to_matrices(attitudes)
    vectors = rotations.reshape(9, -1)
    costs = jnp.sum(vectors * product(form, vectors), axis=0)
    costs = jnp.where(_depth(rotations, to_position, middle) > 0.0, costs, jnp.inf)
    numbers = jnp.arange(costs.shape[0], dtype=jnp.int32)
    found = []
    for _ in range(HYPOTHESES):
        is_best = numbers == jnp.argmin(costs, axis=0).astype(jnp.int32)
        best = jnp.sum(jnp.where(is_best[None], attitudes, 0.0), axis=1)
        found.append(best)
        costs = jnp.where(_are_same(attitudes, best[:, None], _APART), jnp.inf, costs)
    chosen = jnp.stack(found, axis=1)
    return chosen, product(to_position, _to_matrices(chosen).reshape(9, -1))


def _quadratic_form(view: _View) -> tuple[Float[Array, "9 9"], Float[Array, "3 9"], Float[Array, "3"]]:
    """Form of the rows of a rotation matrix, the matrix that gives its best position, and the mean landmark [m].

    The form is the mean of the squares of `X - x Z` and `Y - y Z` of landmarks at (X, Y, Z).
    """
    x, y = view.image[0], view.image[1]
    total = jnp.sum(view.weights, axis=0)
    weights = view.weights * gradient_safe.safe_div(jnp.ones_like(total), total)
    extended = jnp.concatenate([view.landmarks, jnp.ones_like(view.landmarks[:1])])
    squares = extended[:, None] * extended[None, :]
    one, by_x, by_y, by_square = (
        jnp.sum(squares * (weights * factor)[None, None], axis=2)
        for factor in (jnp.ones_like(x), -x, -y, x * x + y * y)
    )
    zero = jnp.zeros_like(one)
    # Moments (4, 4) of landmarks and 1, for each pair of rows of the pose (3, 4).
    moments = jnp.stack(
        [jnp.stack([one, zero, by_x]), jnp.stack([zero, one, by_y]), jnp.stack([by_x, by_y, by_square])]
    )
    turning = jnp.concatenate([jnp.concatenate(list(row[:, :3, :3]), axis=1) for row in moments])
    mixed = jnp.concatenate([moments[:, column, 3, :3] for column in range(3)], axis=1)
    to_position = -product(inverse_positive_definite(moments[:, :, 3, 3]), mixed)
    return turning + product(mixed.T, to_position), to_position, one[3, :3]


def _depth(rotations: Float[Array, "3 3 s"], to_position: Float[Array, "3 9"], middle: Float[Array, "3"]) -> Array:
    """Depth (s,) of the mean landmark [m]."""
    turned = jnp.sum(rotations[2] * middle[:, None], axis=0)
    return jnp.sum(to_position[2][:, None] * rotations.reshape(9, -1), axis=0) + turned


def _descended(form: Float[Array, "9 9"], starts: Float[Array, "4 s"]) -> Float[Array, "4 s"]:
    """Attitudes after damped Gauss-Newton steps on the quadratic form."""

    def step(attitudes: Array, _: Array) -> tuple[Array, None]:
        rotations = _to_matrices(attitudes)
        none = jnp.zeros_like(rotations[0])
        # Changes of the matrix by small turns about each axis: rows of the others exchange places.
        turns = [
            jnp.stack([none, -rotations[2], rotations[1]]),
            jnp.stack([rotations[2], none, -rotations[0]]),
            jnp.stack([-rotations[1], rotations[0], none]),
        ]
        changes = [each.reshape(9, -1) for each in turns]
        products = [product(form, each) for each in changes]
        vectors = rotations.reshape(9, -1)
        slope = jnp.stack([jnp.sum(vectors * each, axis=0) for each in products])
        curvature = jnp.stack([jnp.stack([jnp.sum(a * b, axis=0) for b in products]) for a in changes])
        damping = _DESCENT_DAMPING * (curvature[0, 0] + curvature[1, 1] + curvature[2, 2])
        turn = -solve_positive_definite(
            curvature + jnp.eye(3, dtype=form.dtype)[:, :, None] * damping[None, None], slope
        )
        length = gradient_safe.sqrt(jnp.sum(turn * turn, axis=0))
        turn = turn * jnp.minimum(1.0, _LARGEST_TURN / jnp.maximum(length, 1e-30))[None]
        return _after_turn(turn, attitudes), None

    return short_scan(step, starts, jnp.arange(_DESCENT_STEPS))


def _refined(view: _View, attitudes: Float[Array, "4 k"], positions: Float[Array, "3 k"]) -> _Poses:
    """Least squares of image coordinates near given poses, by the method of Levenberg and Marquardt."""

    def step(carry: tuple[_Poses, Array], _: Array) -> tuple[tuple[_Poses, Array], None]:
        poses, damping = carry
        growth = 1.0 + jnp.eye(6, dtype=damping.dtype)[:, :, None] * damping[None, None]
        moved = _moved(view, poses, -solve_positive_definite(poses.information * growth, poses.slope))
        is_better = moved.cost < poses.cost
        factor = jnp.where(is_better, 1.0 / _DAMPING_CHANGE, _DAMPING_CHANGE)
        return (_chosen(is_better, moved, poses), damping * factor), None

    poses = _least_squares(view, attitudes, positions)
    first = jnp.full_like(poses.cost, _FIRST_DAMPING)
    return short_scan(step, (poses, first), jnp.arange(_REFINING_STEPS))[0]


def _differentiable(view: _View, attitudes: Float[Array, "4 k"], positions: Float[Array, "3 k"]) -> _Poses:
    """The same poses after undamped steps, which bring the derivatives with them.

    Of what a derivative differs from that of the minimum a step leaves as much as of the distance from the minimum.
    """

    def step(poses: _Poses, _: Array) -> tuple[_Poses, None]:
        moved = _moved(view, poses, -solve_positive_definite(poses.information, poses.slope))
        most = poses.cost * (1.0 + 1e-6) + 1e-18 * jnp.sum(view.weights, axis=0)
        return _chosen(moved.cost <= most, moved, poses), None

    return short_scan(step, _least_squares(view, attitudes, positions), jnp.arange(_FINAL_STEPS))


def _chosen(conditions: Bool[Array, " k"], if_true: _Poses, if_false: _Poses) -> _Poses:
    """Each pose from one of two."""
    return jax.tree.map(lambda a, b: jnp.where(jnp.broadcast_to(conditions, a.shape), a, b), if_true, if_false)


def _moved(view: _View, poses: _Poses, change: Float[Array, "6 k"]) -> _Poses:
    """Poses after a turn [rad] and a shift [m] in camera axes."""
    return _least_squares(view, _after_turn(change[:3], poses.quaternion), poses.position + change[3:])


def _least_squares(view: _View, attitudes: Float[Array, "4 k"], positions: Float[Array, "3 k"]) -> _Poses:
    """Poses with cost, information and slope.

    Landmarks are added up one after the other: as a sum of products XLA computes each row again for each product.
    """
    rotations = _to_matrices(attitudes)
    zero = jnp.zeros_like(positions[0])
    pairs = [(i, j) for i in range(7) for j in range(i + 1)]

    def add(sums: list[Array], seen: tuple[Array, Array, Array]) -> tuple[list[Array], None]:
        landmark, image, root = seen
        x, y, z = (jnp.sum(rotations[axis] * landmark[:, None], axis=0) for axis in range(3))
        inverse = 1.0 / jnp.maximum(z + positions[2], _LEAST_DEPTH)
        across, down, scale = (x + positions[0]) * inverse, (y + positions[1]) * inverse, inverse * root
        by_depth = -across * scale, -down * scale
        # Derivatives to a turn and to a shift, and the residual, times the root of the weight.
        rows = (
            [y * by_depth[0], z * scale - x * by_depth[0], -y * scale, scale, zero, by_depth[0]],
            [y * by_depth[1] - z * scale, -x * by_depth[1], x * scale, zero, scale, by_depth[1]],
        )
        rows[0].append((across - image[0]) * root)
        rows[1].append((down - image[1]) * root)
        return [
            each + (rows[0][i] * rows[0][j] + rows[1][i] * rows[1][j]) for each, (i, j) in zip(sums, pairs, strict=True)
        ], None

    seen = view.landmarks.T, view.image.T, gradient_safe.sqrt(view.weights)
    sums = dict(zip(pairs, short_scan(add, [zero] * len(pairs), seen), strict=True))
    return _Poses(
        quaternion=attitudes,
        position=positions,
        cost=sums[6, 6],
        information=jnp.stack([jnp.stack([sums[max(i, j), min(i, j)] for j in range(6)]) for i in range(6)]),
        slope=jnp.stack([sums[6, i] for i in range(6)]),
    )


def _to_matrices(attitudes: Float[Array, "4 k"]) -> Float[Array, "3 3 k"]:
    return jax.vmap(quaternion.to_matrix, -1, -1)(attitudes)


def _after_turn(turns: Float[Array, "3 k"], attitudes: Float[Array, "4 k"]) -> Float[Array, "4 k"]:
    """Attitudes after turns [rad] in camera axes."""

    def of_one(turn: Float[Array, "3"], attitude: Float[Array, "4"]) -> Float[Array, "4"]:
        return quaternion.normalize(quaternion.multiply(quaternion.exp(turn), attitude))

    return jax.vmap(of_one, -1, -1)(turns, attitudes)


def _are_same(a: Float[Array, "4 ..."], b: Float[Array, "4 ..."], angle: float) -> Array:
    """Whether attitudes are less than a small angle [rad] apart, of arrays that are broadcast."""
    apart = jnp.minimum(jnp.sum((a - b) ** 2, axis=0), jnp.sum((a + b) ** 2, axis=0))
    return apart < (0.5 * angle) ** 2


def _sorted(view: _View, poses: _Poses, enough: Array) -> PoseHypotheses:
    """Hypotheses in the order of their costs; last those equal to a better one, behind the camera, or no minimum."""
    count = poses.cost.shape[0]
    last_row = _to_matrices(poses.quaternion)[2]
    depths = product(view.landmarks.T, last_row) + poses.position[2][None]
    is_in_front = jnp.all((depths > _LEAST_DEPTH) | (view.weights[:, None] == 0.0), axis=0)
    covariance = inverse_positive_definite(poses.information)
    gain = jnp.sum(covariance * (poses.slope[:, None] * poses.slope[None, :]), axis=(0, 1))
    cost = jnp.where(is_in_front & (gain <= _LARGEST_GAIN) & enough, poses.cost, jnp.inf)
    same = _are_same(poses.quaternion[:, :, None], poses.quaternion[:, None, :], _SAME_TURN)
    repeats = jnp.any(same & _is_before(cost), axis=0)
    cost = jnp.where(repeats, jnp.inf, cost)
    place = jnp.sum(_is_before(cost), axis=0, dtype=jnp.int32)
    is_at = jnp.arange(count, dtype=jnp.int32)[:, None] == place[None, :]

    rows = [is_at[number] for number in range(count)]

    def ordered(values: Array) -> Array:
        """Values (..., k) with the hypotheses in order, and first."""
        return jnp.stack(
            [jnp.sum(jnp.where(jnp.broadcast_to(row, values.shape), values, 0.0), axis=-1) for row in rows]
        )

    return PoseHypotheses(
        q_KT=ordered(jnp.where(poses.quaternion[:1] < 0.0, -poses.quaternion, poses.quaternion)),
        r_TK_K=ordered(poses.position),
        cost=ordered(cost),
        information=ordered(poses.information),
        covariance=ordered(covariance),
        exists=jnp.isfinite(ordered(cost)),
        enough=enough,
    )


def _is_before(cost: Float[Array, " k"]) -> Bool[Array, "k k"]:
    """Whether the hypothesis of each row comes before that of each column."""
    numbers = np.arange(cost.shape[0])
    earlier = jnp.asarray(numbers[:, None] < numbers[None, :])
    return (cost[:, None] < cost[None, :]) | ((cost[:, None] == cost[None, :]) & earlier)
