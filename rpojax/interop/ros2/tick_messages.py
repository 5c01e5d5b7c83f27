"""Messages of one tick, each with its topic."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from rpojax.interop.ros2 import message_builders, topics
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.ros2.topics import Topic

TopicMessages = Iterable[tuple[Topic, Callable[[], Any]]]
"""Topics, each with a function that builds its message, called only where the message is needed."""


def tick_messages(values: RosTickValues, published: Iterable[Topic] = topics.ALL_TOPICS) -> TopicMessages:
    """Messages of one tick on the `published` topics, in that order; without images and messages sent once."""
    builders = _message_builders(message_builders.nanoseconds(float(values.time_s)), values)
    return [(topic, builders[topic]) for topic in published if topic in builders]


def _message_builders(time_ns: int, values: RosTickValues) -> dict[Topic, Callable[[], Any]]:
    """Builder of the message of each topic that has one in this tick."""
    builders: dict[Topic, Callable[[], Any]] = {
        topics.CLOCK: lambda: message_builders.clock_message(time_ns),
        topics.TF: lambda: message_builders.vehicle_transforms(time_ns, values),
        **_odometry_builders(time_ns, values),
    }
    if values.gps_present:
        builders[topics.GPS] = lambda: message_builders.gps(time_ns, values.gps)
    if values.star_tracker_present:
        builders[topics.STAR_TRACKER] = lambda: message_builders.star_tracker(time_ns, values.star_tracker)
    return builders | {
        topics.IMU: lambda: message_builders.imu(time_ns, values.gyro, float(values.gyro_variance)),
        topics.WHEELS: lambda: message_builders.wheel_state(time_ns, values.wheel_speed, values.wheel_torque),
        topics.WHEEL_COMMAND: lambda: message_builders.wheel_command(time_ns, values.wheel_command),
        topics.THRUSTER_COMMAND: lambda: _pending_burn(time_ns, values),
        topics.CAMERA_INFO: lambda: message_builders.camera_info(time_ns, values.camera),
        topics.DETECTIONS: lambda: message_builders.detections(time_ns, values.camera),
        topics.DIAGNOSTICS: lambda: message_builders.diagnostics(time_ns, values),
    }


def _odometry_builders(time_ns: int, values: RosTickValues) -> dict[Topic, Callable[[], Any]]:
    motions = {
        topics.SERVICER_TRUTH: values.servicer,
        topics.RELATIVE_TRUTH: values.relative,
        topics.TARGET_TRUTH: values.target,
        topics.SERVICER_ESTIMATE: values.servicer_estimate,
        topics.RELATIVE_ESTIMATE: values.relative_estimate,
        topics.TARGET_ESTIMATE: values.target_estimate,
    }
    return {
        topic: partial(message_builders.odometry, time_ns, topic.frame_id, topic.child_frame_id, motion)
        for topic, motion in motions.items()
    }


def _pending_burn(time_ns: int, values: RosTickValues) -> Any:
    ignition_ns = message_builders.nanoseconds(float(values.ignition_s))
    cutoff_ns = message_builders.nanoseconds(float(values.cutoff_s))
    return message_builders.thruster_command(time_ns, ignition_ns, cutoff_ns, float(values.thrust))
