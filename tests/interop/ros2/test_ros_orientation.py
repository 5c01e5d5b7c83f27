"""ROS orientation of a rotation that can be worked out by hand."""

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from rpojax.core import quaternion
from rpojax.interop.ros2.odometry import orientation_from_quaternion, quaternion_from_orientation


def test_the_orientation_of_a_body_rotated_by_90_degrees_about_z() -> None:
    half = np.sqrt(0.5)
    # The body's x axis lies along the parent's y: parent components (0, 1, 0) are body components (1, 0, 0).
    q_BA = jnp.array([half, 0.0, 0.0, -half])
    np.testing.assert_allclose(quaternion.rotate(q_BA, jnp.array([0.0, 1.0, 0.0])), [1.0, 0.0, 0.0], atol=1e-15)
    xyzw = orientation_from_quaternion(q_BA)
    np.testing.assert_allclose(xyzw, [0.0, 0.0, half, half], atol=1e-15)
    # ROS tools rotate the child's axis into the parent.
    np.testing.assert_allclose(Rotation.from_quat(np.asarray(xyzw)).apply([1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_array_equal(quaternion_from_orientation(xyzw), q_BA)
