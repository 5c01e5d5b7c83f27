"""Messages that a live run publishes at each point of a tick."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from rpojax.core.pytree import replace
from rpojax.interop.cosimulation import live_topics
from rpojax.interop.cosimulation.compiled_step_stages import AttitudeValues, GuidedValues, NavigatedValues
from rpojax.interop.cosimulation.live_settings import ExternalStage, LiveSettings
from rpojax.interop.ros2 import message_builders, topics
from rpojax.interop.ros2.message_builders import TopicMessages, nanoseconds, tick_messages
from rpojax.interop.ros2.topics import Topic

_AFTER_GUIDANCE = (topics.TARGET_ESTIMATE, topics.WHEEL_COMMAND, topics.THRUSTER_COMMAND, topics.DIAGNOSTICS)
"""Sent after guidance."""
_AWAITED = (topics.CLOCK, topics.SERVICER_ESTIMATE, topics.RELATIVE_ESTIMATE, topics.WHEELS)
"""Sent first, because external nodes compute their commands from them; the rest is sent meanwhile."""
_AFTER_AWAITED = tuple(topic for topic in topics.ALL_TOPICS if topic not in (*_AWAITED, *_AFTER_GUIDANCE))


class LiveMessages:
    """Messages of one live run; `step_ns` is the plant step [ns]."""

    def __init__(self, settings: LiveSettings, step_ns: int) -> None:
        self._attitude_is_external = ExternalStage.ATTITUDE in settings.external_stages
        self._formation_is_external = ExternalStage.FORMATION in settings.external_stages
        self._step_ns = step_ns

    def after_navigation(self, values: NavigatedValues) -> TopicMessages:
        """Messages at the beginning of a tick: time and what external nodes wait for, then truth and measurements."""
        tick, time_ns = values.tick, nanoseconds(float(values.tick.time_s))
        if self._attitude_is_external:
            # The motor torques are not known yet.
            tick = replace(tick, wheel_torque=np.zeros(0))
        yield from tick_messages(tick, _AWAITED)
        if self._attitude_is_external and self._formation_is_external:
            yield _attitude_estimate(time_ns, values.attitude)
        yield from tick_messages(tick, _AFTER_AWAITED)
        if time_ns == 0:
            yield topics.TF_STATIC, partial(message_builders.camera_transform, time_ns, tick)

    def camera_image(self, time_ns: int, render: Callable[[], np.ndarray]) -> TopicMessages:
        """Image message of a tick, rendered only where there is a subscriber."""
        return [(topics.IMAGE, lambda: message_builders.image(time_ns, render()))]

    def attitude_reference(self, values: GuidedValues, navigated: NavigatedValues) -> TopicMessages:
        """Attitude reference after guidance, then the first attitude for a node that follows that reference."""
        if not self._attitude_is_external:
            return
        time_ns, points = nanoseconds(float(values.tick.time_s)), map(np.asarray, values.attitude_reference)
        yield live_topics.ATTITUDE_REFERENCE, partial(live_topics.attitude_reference, time_ns, self._step_ns, *points)
        if not self._formation_is_external:
            yield _attitude_estimate(time_ns, navigated.attitude)

    def after_guidance(self, values: GuidedValues) -> TopicMessages:
        """Commands and status of the flight software, after guidance."""
        return tick_messages(values.tick, _AFTER_GUIDANCE)

    def plant_step(self, time_ns: int, values: AttitudeValues) -> TopicMessages:
        """Messages before a plant step within a tick, where wheel torques are external."""
        variance, wheel_speed = float(values.gyro_variance), np.asarray(values.wheel_speed)
        return [
            (topics.CLOCK, partial(message_builders.clock_message, time_ns)),
            (topics.WHEELS, partial(message_builders.wheel_state, time_ns, wheel_speed, np.zeros(0))),
            _attitude_estimate(time_ns, values),
            (topics.IMU, partial(message_builders.imu, time_ns, np.asarray(values.gyro), variance)),
        ]


def _attitude_estimate(time_ns: int, values: AttitudeValues) -> tuple[Topic, Callable[[], Any]]:
    arrays = values.orientation, values.rate, values.covariance, values.rate_covariance
    return live_topics.ATTITUDE_ESTIMATE, partial(live_topics.attitude_estimate, time_ns, *map(np.asarray, arrays))
