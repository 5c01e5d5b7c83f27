"""Topics that only live runs have, beside those of `topics`, and builders of their messages."""

from collections.abc import Set as AbstractSet
from typing import Any

import numpy as np

from rpojax.interop.cosimulation.live_settings import ExternalStage
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.message_builders import duration_message, header_message, quaternion_message, vector_message
from rpojax.interop.ros2.message_types import message_class
from rpojax.interop.ros2.topics import ECI, SERVICER, Topic, TopicRate, TopicSource

ATTITUDE_ESTIMATE = Topic(
    "/servicer/estimate/attitude",
    "sensor_msgs/msg/Imu",
    SERVICER,
    "",
    TopicSource.FLIGHT,
    TopicRate.TICK,
    "orientation in `eci` and rate minus gyro bias, with covariance; at every plant step where attitude is external",
)
ATTITUDE_REFERENCE = Topic(
    "/servicer/guidance/attitude",
    "trajectory_msgs/msg/MultiDOFJointTrajectory",
    ECI,
    "",
    TopicSource.FLIGHT,
    TopicRate.TICK,
    "orientation, rate and angular acceleration that guidance wants, one point for every plant step of the tick",
)
ATTITUDE_TARGET = Topic(
    "/servicer/attitude/target",
    "geometry_msgs/msg/QuaternionStamped",
    ECI,
    "",
    TopicSource.FLIGHT,
    TopicRate.TICK,
    "orientation of the servicer in `eci` during the burn of the thruster command with the same stamp",
)
COMMAND_TOPICS: dict[ExternalStage, tuple[Topic, ...]] = {
    ExternalStage.ATTITUDE: (topics.WHEEL_COMMAND,),
    ExternalStage.FORMATION: (topics.THRUSTER_COMMAND, ATTITUDE_TARGET),
    ExternalStage.NAVIGATION: (topics.SERVICER_ESTIMATE, topics.RELATIVE_ESTIMATE),
}
"""Topics that external nodes publish, by stage."""


def attitude_estimate(
    time_ns: int, orientation: np.ndarray, rate: np.ndarray, covariance: np.ndarray, rate_covariance: np.ndarray
) -> Any:
    """`sensor_msgs/Imu` of an estimated orientation (x, y, z, w) and rate [rad/s], without acceleration."""
    return message_class("sensor_msgs/msg/Imu")(
        header=header_message(time_ns, SERVICER),
        orientation=quaternion_message(orientation),
        orientation_covariance=np.ascontiguousarray(covariance).reshape(9),
        angular_velocity=vector_message(rate),
        angular_velocity_covariance=np.ascontiguousarray(rate_covariance).reshape(9),
        linear_acceleration=vector_message(np.zeros(3)),
        linear_acceleration_covariance=np.array([-1.0, *[0.0] * 8]),
    )


def attitude_reference(
    time_ns: int, step_ns: int, orientations: np.ndarray, rates: np.ndarray, accelerations: np.ndarray
) -> Any:
    """`trajectory_msgs/MultiDOFJointTrajectory`, a point every `step_ns` [ns] from the stamp on.

    Orientations (n, 4) are x, y, z, w of the commanded body in `eci`, rates (n, 3) [rad/s] and accelerations (n, 3)
    [rad/s^2] along its axes.
    """
    point, twist = message_class("trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"), _angular_twist
    transform_class = message_class("geometry_msgs/msg/Transform")
    zero = vector_message(np.zeros(3))
    return message_class("trajectory_msgs/msg/MultiDOFJointTrajectory")(
        header=header_message(time_ns, ECI),
        joint_names=[SERVICER],
        points=[
            point(
                transforms=[transform_class(translation=zero, rotation=quaternion_message(orientation))],
                velocities=[twist(rate)],
                accelerations=[twist(acceleration)],
                time_from_start=duration_message(index * step_ns),
            )
            for index, (orientation, rate, acceleration) in enumerate(
                zip(orientations, rates, accelerations, strict=True)
            )
        ],
    )


def _angular_twist(values: np.ndarray) -> Any:
    return message_class("geometry_msgs/msg/Twist")(linear=vector_message(np.zeros(3)), angular=vector_message(values))


def command_topics(external_stages: AbstractSet[ExternalStage]) -> tuple[Topic, ...]:
    """Topics of the commands that the simulator receives."""
    return tuple(topic for stage in ExternalStage if stage in external_stages for topic in COMMAND_TOPICS[stage])


def published_topics(external_stages: AbstractSet[ExternalStage]) -> tuple[Topic, ...]:
    """Topics that the simulator publishes."""
    attitude_topics = (ATTITUDE_ESTIMATE, ATTITUDE_REFERENCE)
    received = {topic.name for topic in command_topics(external_stages)}
    candidates = (*topics.ALL_TOPICS, *(attitude_topics if ExternalStage.ATTITUDE in external_stages else ()))
    return tuple(topic for topic in candidates if topic.name not in received and topic is not topics.COMPRESSED_IMAGE)
