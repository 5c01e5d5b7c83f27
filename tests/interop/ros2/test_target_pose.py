"""Pose of the target in the camera as a ROS user reads it: axes, order of the covariance, and who knows it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.flight.navigation import outline_correlation
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate, layout_of
from rpojax.flight.navigation.target_attitude_ekf import TargetAttitude
from rpojax.interop.ros2 import run_bag, topics
from rpojax.interop.ros2.message_builders import tick_messages
from rpojax.interop.ros2.message_types import deserialize, serialize
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.ros2.run_bag import ImageStorage
from rpojax.interop.ros2.target_pose import TargetPose, target_pose
from rpojax.interop.run_replay import ReplayedRun

SLOW = {"attitude": 3, "rate": 3, "inertia_ratio": 2, "body_offset": 3, "size": 2}
POSITION_M, SIGMA_M, SIGMA_RAD = np.array([3.0, -1.0, 7.0]), 0.02, 0.003


def quaternion_of(rotation: Rotation) -> jnp.ndarray:
    """Scalar-first `q_BA` of the body that a rotation takes the axes of A to."""
    return jnp.asarray(np.roll(rotation.inv().as_quat(), 1))


def estimate(covariance: np.ndarray) -> RelativeEstimate:
    """Filter with landmarks whose attitude error is correlated with the position."""
    reference = TargetAttitude(
        q_TN=quaternion_of(Rotation.from_rotvec([0.4, -1.1, 0.7])),
        inertia=jnp.eye(3),
        known=jnp.asarray(True),
        unexplained_s=jnp.zeros(()),
    )
    slow = {name: jnp.zeros(size) for name, size in SLOW.items()}
    return RelativeEstimate(
        r_TS_N=jnp.asarray(POSITION_M),
        v_TS_N=jnp.zeros(3),
        slow=slow,
        covariance=jnp.asarray(covariance),
        outline=outline_correlation.initial(),
        target=reference,
    )


@pytest.fixture(scope="module")
def covariance() -> np.ndarray:
    """Covariance of all states, of position and attitude with correlations of any size."""
    layout = layout_of(frozenset(SLOW))
    numbers = [*layout.places("position"), *layout.places("attitude")]
    scale = np.array([SIGMA_M] * 3 + [SIGMA_RAD] * 3)
    root = scale[:, None] * np.random.default_rng(8).normal(size=(6, 6))
    P = 1e-6 * np.eye(layout.size)
    P[np.ix_(numbers, numbers)] = root @ root.T
    return P


def test_the_covariance_is_that_of_sampled_states_about_the_fixed_axes_of_the_camera(covariance: np.ndarray) -> None:
    q_KN = quaternion_of(Rotation.from_rotvec([-0.9, 0.3, 2.0]))
    mean = estimate(covariance)
    pose = target_pose(mean, q_KN)
    assert pose is not None
    layout = mean.layout
    errors = np.random.default_rng(9).multivariate_normal(np.zeros(layout.size), covariance, 20_000)

    def sampled(error: jnp.ndarray) -> TargetPose | None:
        slow = {**mean.slow, "attitude": error[layout["attitude"]]}
        return target_pose(replace(mean, r_TS_N=mean.r_TS_N + error[layout["position"]], slow=slow), q_KN)

    found = jax.vmap(sampled)(jnp.asarray(errors))
    assert found is not None
    turns = Rotation.from_quat(np.asarray(found.orientation)) * Rotation.from_quat(np.asarray(pose.orientation)).inv()
    changes = np.concatenate([np.asarray(found.position) - np.asarray(pose.position), turns.as_rotvec()], axis=1)
    sigmas = np.sqrt(np.diag(np.asarray(pose.covariance)))
    correlations = np.asarray(pose.covariance) / np.outer(sigmas, sigmas)
    assert np.abs(correlations[:3, 3:]).max() > 0.3, "a sign between place and turn matters"
    np.testing.assert_allclose(np.cov(changes.T) / np.outer(sigmas, sigmas), correlations, atol=0.04)


def test_the_pose_puts_points_of_the_target_where_the_camera_sees_them(covariance: np.ndarray) -> None:
    mean, R_NK = estimate(covariance), Rotation.from_rotvec([-0.9, 0.3, 2.0])
    pose = target_pose(mean, quaternion_of(R_NK))
    assert pose is not None
    assert mean.target is not None
    corner_T = np.array([0.5, -0.2, 0.9])
    R_TN = np.asarray(quaternion.to_matrix(mean.target.q_TN))
    corner_K = R_NK.inv().apply(POSITION_M + R_TN.T @ corner_T)
    found = np.asarray(pose.position) + Rotation.from_quat(np.asarray(pose.orientation)).apply(corner_T)
    np.testing.assert_allclose(found, corner_K, atol=1e-12)


def test_the_message_read_back_is_the_pose_and_there_is_none_before_it_is_known(
    ros_run: ReplayedRun[RosTickValues], covariance: np.ndarray
) -> None:
    pose = target_pose(estimate(covariance), quaternion_of(Rotation.from_rotvec([-0.9, 0.3, 2.0])))
    assert pose is not None
    tick = ros_run.tick(4)
    assert topics.TARGET_POSE not in dict(tick_messages(tick))
    message = dict(tick_messages(dataclasses.replace(tick, target_pose=pose)))[topics.TARGET_POSE]()
    read = deserialize(serialize(message), topics.TARGET_POSE.type)
    assert read.header.frame_id == "servicer/camera_optical_frame"
    assert read.header.stamp.sec == round(float(tick.time_s))
    np.testing.assert_array_equal(read.pose.covariance.reshape(6, 6), pose.covariance)
    where, turn = read.pose.pose.position, read.pose.pose.orientation
    np.testing.assert_array_equal([where.x, where.y, where.z], pose.position)
    np.testing.assert_array_equal([turn.x, turn.y, turn.z, turn.w], pose.orientation)
    lost = replace(pose, known=jnp.asarray(False))
    assert topics.TARGET_POSE not in dict(tick_messages(dataclasses.replace(tick, target_pose=lost)))


def test_bags_have_the_topic_where_the_attitude_is_estimated() -> None:
    assert topics.TARGET_POSE not in run_bag.bag_topics(ImageStorage.NONE)
    assert topics.TARGET_POSE in run_bag.bag_topics(ImageStorage.NONE, has_pose=True)
    named = {topic.name for topic in run_bag.team_topics(["first", "second"], ImageStorage.NONE, has_pose=True)}
    assert {"/first/target/estimate/pose", "/second/target/estimate/pose"} <= named
