"""Pose of a target from the landmarks that a network found in a picture."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree
from rpojax.flight.navigation.perspective_n_point import FEWEST, PoseHypotheses, solve_pose
from rpojax.vision.landmark_network.find_landmarks import IN_SIGHT, FoundLandmarks

_LARGEST_MISS = 16.0
"""Square of the distance of a landmark from the pose by its covariance beyond which it is left out: 4 sigma."""
_REWEIGHTINGS = 3
_CAUCHY_SQUARE = 4.0
"""Square of the distance at which a landmark counts by half in the robust pose (Cauchy's weights)."""
_MODEL_SIGMA_PX = 0.05
"""Error of every place beside that of its covariance."""


@pytree
class LandmarkPose:
    """Pose by the landmarks of one picture.

    Attributes:
        q_KT: (4,) attitude of the target in the camera
        r_TK_K: (3,) position of the target's origin from the camera [m]
        exists: () bool, whether there is a pose at all
        used: (k,) bool, whether it is of that landmark
    """

    q_KT: Array
    r_TK_K: Array
    exists: Array
    used: Array


def landmark_pose(
    landmarks_T: Float[Array, "k 3"], found: FoundLandmarks, focal_px: Float[Array, ""], center_px: Float[Array, "2"]
) -> LandmarkPose:
    """Pose of least squares of the visible landmarks without those that are far from a robust one."""
    tangents = (found.places.astype(landmarks_T.dtype) - center_px[None]) / focal_px
    model = _MODEL_SIGMA_PX**2 * jnp.eye(2, dtype=landmarks_T.dtype)
    covariance = found.covariance.astype(landmarks_T.dtype) + model[None]
    visible = found.visible_probability > IN_SIGHT
    # A weight is that of a round error of the same mean square.
    weights = jnp.where(visible, 2.0 * focal_px**2 / (covariance[:, 0, 0] + covariance[:, 1, 1]), 0.0)
    tangent_covariance = covariance / focal_px**2
    pose = solve_pose(landmarks_T, tangents, weights)
    for _ in range(_REWEIGHTINGS):
        squares = _squares(landmarks_T, pose, tangents, tangent_covariance)
        pose = solve_pose(landmarks_T, tangents, weights / (1.0 + squares / _CAUCHY_SQUARE))
    near = visible & (_squares(landmarks_T, pose, tangents, tangent_covariance) < _LARGEST_MISS)
    enough = jnp.sum(near, dtype=jnp.int32) >= FEWEST
    used = jnp.where(enough, near, visible)
    last = solve_pose(landmarks_T, tangents, jnp.where(used, weights, 0.0))
    return LandmarkPose(q_KT=last.q_KT[0], r_TK_K=last.r_TK_K[0], exists=last.exists[0], used=used)


def _squares(
    landmarks_T: Float[Array, "k 3"],
    pose: PoseHypotheses,
    tangents: Float[Array, "k 2"],
    covariance: Float[Array, "k 2 2"],
) -> Float[Array, " k"]:
    """Squares of the distances of landmarks from the best pose, by their covariances."""
    places = jax.vmap(quaternion.rotate, (None, 0))(pose.q_KT[0], landmarks_T) + pose.r_TK_K[0][None]
    miss = tangents - places[:, :2] / jnp.maximum(places[:, 2:], 1e-3)
    return jnp.einsum("ki,ki->k", miss, jnp.linalg.solve(covariance, miss[..., None])[..., 0])
