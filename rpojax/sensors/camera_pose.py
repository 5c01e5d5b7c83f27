"""True attitude of the camera, and the target's pose and hull in camera axes."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.quaternion import rotate
from rpojax.sensors.camera import Camera

Vector = Float[Array, "3"]


def camera_attitude(camera: Camera, q_BN: Float[Array, "4"]) -> Float[Array, "4"]:
    """True `q_KN` of the camera on a body at `q_BN`."""
    q_KB = quaternion.multiply(quaternion.exp(camera.misalignment), quaternion.normalize(camera.mounting))
    return quaternion.multiply(q_KB, q_BN)


def target_pose_in_camera(
    camera: Camera, q_TN: Array, r_ST_N: Vector, q_BN: Array
) -> tuple[Float[Array, "3 3"], Vector]:
    """Rotation `R_KT` and position `r_TK_K` [m] of the target in camera axes."""
    q_KN = camera_attitude(camera, q_BN)
    return quaternion.to_matrix(quaternion.multiply(q_KN, quaternion.conjugate(q_TN))), rotate(q_KN, -r_ST_N)


def hull_in_camera(hull_T: Float[Array, "n 3"], R_KT: Float[Array, "3 3"], r_TK_K: Vector) -> Float[Array, "n 3"]:
    """Hull vertices [m] in camera axes."""
    return jnp.sum(R_KT[None, :, :] * hull_T[:, None, :], axis=2) + r_TK_K[None, :]
