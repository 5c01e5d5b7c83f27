"""What a live run says at each point of a tick."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from rpojax.core.pytree import replace
from rpojax.interop.cosimulation import live_topics
from rpojax.interop.cosimulation.compiled_stages import AttitudeValues, GuidedValues, NavigatedValues
from rpojax.interop.cosimulation.live_settings import ExternalStage, LiveSettings
from rpojax.interop.ros2 import message_builders, topics
from rpojax.interop.ros2.message_builders import TopicMessages, nanoseconds
from rpojax.interop.ros2.topics import Topic

_AFTER_GUIDANCE = (topics.TARGET_ESTIMATE, topics.WHEEL_COMMAND, topics.THRUSTER_COMMAND, topics.DIAGNOSTICS)
"""Said when the flight software has decided."""
_AWAITED = (topics.CLOCK, topics.SERVICER_ESTIMATE, topics.RELATIVE_ESTIMATE, topics.WHEELS)
"""Said first, since others decide by it; while they do, the rest is said."""
_AFTER_AWAITED = tuple(topic for topic in topics.ALL_TOPICS if topic not in (*_AWAITED, *_AFTER_GUIDANCE))


class TickMessages:
    """Makes the messages of one run; `step_ns` is that of the plant [ns]."""

    def __init__(self, settings: LiveSettings, step_ns: int) -> None:
        self._attitude_is_external = ExternalStage.ATTITUDE in settings.external_stages
        self._formation_is_external = ExternalStage.FORMATION in settings.external_stages
        self._step_ns = step_ns

    def after_navigation(self, values: NavigatedValues) -> TopicMessages:
        """At the beginning of a tick: time, what others decide by, then truth and measurements."""
        tick, time_ns = values.tick, nanoseconds(float(values.tick.time_s))
        if self._attitude_is_external:
            # The motors' torques are not decided yet.
            tick = replace(tick, wheel_torque=np.zeros(0))
        yield from message_builders.tick_messages(tick, _AWAITED)
        if self._attitude_is_external and self._formation_is_external:
            yield _attitude_estimate(time_ns, values.attitude)
        yield from message_builders.tick_messages(tick, _AFTER_AWAITED)
        if time_ns == 0:
            yield topics.TF_STATIC, partial(message_builders.camera_transform, time_ns, tick)

    def camera_image(self, time_ns: int, render: Callable[[], np.ndarray]) -> TopicMessages:
        """The picture of a tick, which is not taken for nobody."""
        return [(topics.IMAGE, lambda: message_builders.image(time_ns, render()))]

    def attitude_reference(self, values: GuidedValues, navigated: NavigatedValues) -> TopicMessages:
        """The attitude reference, once decided; who follows it hears the first attitude after it."""
        if not self._attitude_is_external:
            return
        at, points = nanoseconds(float(values.tick.time_s)), map(np.asarray, values.attitude_reference)
        yield live_topics.ATTITUDE_REFERENCE, partial(live_topics.attitude_reference, at, self._step_ns, *points)
        if not self._formation_is_external:
            yield _attitude_estimate(at, navigated.attitude)

    def after_guidance(self, values: GuidedValues) -> TopicMessages:
        """Once all is decided: what flight software is up to."""
        return message_builders.tick_messages(values.tick, _AFTER_GUIDANCE)

    def plant_step(self, time_ns: int, values: AttitudeValues) -> TopicMessages:
        """Before a plant step within a tick whose torques come from outside."""
        variance = float(values.gyro_variance)
        return [
            (topics.CLOCK, partial(message_builders.clock_message, time_ns)),
            (
                topics.WHEELS,
                partial(message_builders.wheel_state, time_ns, np.asarray(values.wheel_speed), np.zeros(0)),
            ),
            _attitude_estimate(time_ns, values),
            (topics.IMU, partial(message_builders.imu, time_ns, np.asarray(values.gyro), variance)),
        ]


def _attitude_estimate(time_ns: int, values: AttitudeValues) -> tuple[Topic, Callable[[], Any]]:
    arrays = values.orientation, values.rate, values.covariance, values.rate_covariance
    return live_topics.ATTITUDE_ESTIMATE, partial(live_topics.attitude_estimate, time_ns, *map(np.asarray, arrays))
