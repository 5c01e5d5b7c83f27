"""Pose of a target from the landmarks that a network found in a picture."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree
from rpojax.flight.navigation.perspective_n_point import FEWEST, PoseHypotheses, solve_pose
from rpojax.vision.landmark_network.find_landmarks import FoundLandmarks

LEAST_PROBABILITY = 0.5
"""Of a landmark that counts as visible."""
_LARGEST_MISS = 16.0
"""Square of the distance of a landmark from the pose by its covariance beyond which it is left out: 4 sigma."""
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
    """Pose of least squares of the visible landmarks, solved anew without those that are far from the first one."""
    tangents = (found.places.astype(landmarks_T.dtype) - center_px) / focal_px
    covariance = found.covariance.astype(landmarks_T.dtype) + _MODEL_SIGMA_PX**2 * jnp.eye(2, dtype=landmarks_T.dtype)
    visible = found.visible_probability > LEAST_PROBABILITY
    # A weight is that of a round error of the same mean square.
    weights = 2.0 * focal_px**2 / (covariance[:, 0, 0] + covariance[:, 1, 1])
    first = solve_pose(landmarks_T, tangents, jnp.where(visible, weights, 0.0))
    near = visible & (_squares(landmarks_T, first, tangents, covariance / focal_px**2) < _LARGEST_MISS)
    enough = jnp.sum(near, dtype=jnp.int32) >= FEWEST
    used = jnp.where(enough, near, visible)
    second = solve_pose(landmarks_T, tangents, jnp.where(used, weights, 0.0))
    return LandmarkPose(q_KT=second.q_KT[0], r_TK_K=second.r_TK_K[0], exists=second.exists[0], used=used)


def _squares(
    landmarks_T: Float[Array, "k 3"],
    pose: PoseHypotheses,
    tangents: Float[Array, "k 2"],
    covariance: Float[Array, "k 2 2"],
) -> Float[Array, " k"]:
    """Squares of the distances of landmarks from the best pose, by their covariances."""
    places = jax.vmap(quaternion.rotate, (None, 0))(pose.q_KT[0], landmarks_T) + pose.r_TK_K[0]
    miss = tangents - places[:, :2] / jnp.maximum(places[:, 2:], 1e-3)
    return jnp.einsum("ki,ki->k", miss, jnp.linalg.solve(covariance, miss[..., None])[..., 0])


def is_pose(pose: LandmarkPose) -> Bool[Array, ""]:
    """Whether a pose exists and has finite numbers."""
    return pose.exists & jnp.all(jnp.isfinite(pose.r_TK_K))
