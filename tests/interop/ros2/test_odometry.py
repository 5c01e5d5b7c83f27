"""Odometry values and covariances, on cases that can be worked out by hand."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rpojax.interop.ros2.odometry import Odometry, estimated_odometry, hill_covariance

SIDE = np.sqrt(0.5)


def random_spd(seed: int, size: int) -> jnp.ndarray:
    """A random covariance."""
    A = np.random.default_rng(seed).normal(size=(size, size))
    return jnp.asarray(A @ A.T)


def rotated_body() -> Odometry:
    """A body rotated by 90 degrees about z that moves along the parent's y, with six different variances."""
    return estimated_odometry(
        position=jnp.array([1.0, 2.0, 3.0]),
        q_BA=jnp.array([SIDE, 0.0, 0.0, -SIDE]),
        velocity=jnp.array([0.0, 5.0, 0.0]),
        rate=jnp.array([0.1, 0.2, 0.3]),
        orbit_covariance=jnp.diag(jnp.array([1.0, 4.0, 9.0, 16.0, 25.0, 36.0])),
        attitude_covariance=jnp.diag(jnp.array([1e-4, 4e-4, 9e-4])),
        rate_covariance=jnp.diag(jnp.array([1e-6, 4e-6, 9e-6])),
    )


def test_a_pose_is_in_the_parent_and_a_twist_in_the_child() -> None:
    found = rotated_body()
    np.testing.assert_allclose(found.velocity, [5.0, 0.0, 0.0], atol=1e-14)
    np.testing.assert_array_equal(found.rate, [0.1, 0.2, 0.3])
    # A rotation error about the body's x is one about the parent's y.
    np.testing.assert_allclose(found.pose_covariance, np.diag([1.0, 4.0, 9.0, 4e-4, 1e-4, 9e-4]), atol=1e-15)
    np.testing.assert_allclose(found.twist_covariance, np.diag([25.0, 16.0, 36.0, 1e-6, 4e-6, 9e-6]), atol=1e-14)


@pytest.mark.parametrize("seed", range(3))
def test_a_twist_rotated_back_gives_velocity_and_covariance_in_the_parent(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = jnp.asarray(rng.normal(size=4))
    q, v, P = q / jnp.linalg.norm(q), jnp.asarray(rng.normal(size=3)), random_spd(seed, 6)
    found = estimated_odometry(jnp.zeros(3), q, v, jnp.zeros(3), P, random_spd(seed + 10, 3), random_spd(seed + 20, 3))
    R = Rotation.from_quat(np.asarray(found.orientation)).as_matrix()
    np.testing.assert_allclose(R @ np.asarray(found.velocity), v, atol=1e-14)
    np.testing.assert_allclose(R @ np.asarray(found.twist_covariance[:3, :3]) @ R.T, P[3:, 3:], atol=1e-13)
    np.testing.assert_allclose(
        R.T @ np.asarray(found.pose_covariance[3:, 3:]) @ R, random_spd(seed + 10, 3), atol=1e-13
    )
    np.testing.assert_array_equal(found.pose_covariance[:3, 3:], np.zeros((3, 3)))


def test_the_velocity_covariance_in_a_rotating_frame_includes_position_variance() -> None:
    rate, sigma = 0.25, 2.0
    P = jnp.diag(jnp.array([sigma**2, 0.0, 0.0, 0.0, 0.0, 0.01]))
    found = hill_covariance(jnp.eye(3), jnp.array([0.0, 0.0, rate]), P)
    # rho_dot = v - omega x r, so an error of x in r is one of -omega x in rho_dot's y.
    expected = np.zeros((6, 6))
    expected[0, 0], expected[4, 4], expected[5, 5] = sigma**2, (rate * sigma) ** 2, 0.01
    expected[0, 4] = expected[4, 0] = -rate * sigma**2
    np.testing.assert_allclose(found, expected, atol=1e-15)
