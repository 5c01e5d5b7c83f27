"""Estimated pose of the target in the servicer's camera, with the covariance of both in the order of ROS 2."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree
from rpojax.flight.navigation import target_attitude_ekf
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.interop.ros2.odometry import orientation_from_quaternion, relative_quaternion


@pytree
class TargetPose:
    """Pose of the target's body in the camera.

    Attributes:
        position: (3,) of its centre of mass [m] in K
        orientation: (4,) x, y, z, w of T in K
        covariance: (6, 6) of position and small rotation about the fixed axes of K [m, rad]
        known: () bool, flight software knows the attitude
    """

    position: Array
    orientation: Array
    covariance: Array
    known: Array


def target_pose(relative: RelativeEstimate, q_KN: Float[Array, "4"]) -> TargetPose | None:
    """Pose by the relative filter, for an estimated attitude of the camera; None of a filter without the attitude.

    The covariance is the filter's, turned into the camera with that attitude, whose own error is left out: the
    camera sees this pose without it.
    """
    if relative.target is None:
        return None
    q_TK = relative_quaternion(target_attitude_ekf.attitude(relative.target, relative.slow), q_KN)
    R_KN, R_KT = quaternion.to_matrix(q_KN), quaternion.to_matrix(q_TK).T
    layout = relative.layout
    numbers = jnp.array([*layout.places("position"), *layout.places("attitude")])
    # The filter's small turn takes components into those of the turned axes: the axes themselves turn against it.
    zero = jnp.zeros_like(R_KN)
    jacobian = jnp.concatenate([jnp.concatenate([R_KN, zero], axis=1), jnp.concatenate([zero, -R_KT], axis=1)], axis=0)
    return TargetPose(
        position=quaternion.rotate(q_KN, relative.r_TS_N),
        orientation=orientation_from_quaternion(q_TK),
        covariance=jacobian @ relative.covariance[numbers][:, numbers] @ jacobian.T,
        known=relative.target.certain,
    )
