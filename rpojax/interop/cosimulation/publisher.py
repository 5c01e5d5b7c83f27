"""What a live run says at each point of a tick."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from rpojax.core.pytree import replace
from rpojax.interop.cosimulation import live_topics
from rpojax.interop.cosimulation.compiled_stages import AttitudeValues, DecidedValues, SensedValues
from rpojax.interop.cosimulation.live_settings import Settings, Stage
from rpojax.interop.ros2 import message_builders, topics
from rpojax.interop.ros2.message_builders import Said, nanoseconds
from rpojax.interop.ros2.topics import Topic

_DECIDED = (topics.TARGET_ESTIMATE, topics.WHEEL_COMMAND, topics.THRUSTER_COMMAND, topics.DIAGNOSTICS)
"""Said when the flight software has decided."""
_AWAITED = (topics.CLOCK, topics.SERVICER_ESTIMATE, topics.RELATIVE_ESTIMATE, topics.WHEELS)
"""Said first, since others decide by it; while they do, the rest is said."""
_REST = tuple(topic for topic in topics.TABLE if topic not in (*_AWAITED, *_DECIDED))


class Words:
    """Makes the messages of one run; `step_ns` is that of the plant [ns]."""

    def __init__(self, settings: Settings, step_ns: int) -> None:
        self._attitude_is_external = Stage.ATTITUDE in settings.external
        self._formation_is_external = Stage.FORMATION in settings.external
        self._step_ns = step_ns

    def sensed(self, values: SensedValues) -> Said:
        """At the beginning of a tick: time, what others decide by, then truth and measurements."""
        tick, at = values.tick, nanoseconds(float(values.tick.time_s))
        if self._attitude_is_external:
            # The motors' torques are not decided yet.
            tick = replace(tick, wheel_torque=np.zeros(0))
        yield from message_builders.of_tick(tick, _AWAITED)
        if self._attitude_is_external and self._formation_is_external:
            yield _attitude(at, values.attitude)
        yield from message_builders.of_tick(tick, _REST)
        if at == 0:
            yield topics.TF_STATIC, partial(message_builders.camera_mounting, at, tick)

    def picture(self, at: int, take: Callable[[], np.ndarray]) -> Said:
        """The picture of a tick, which is not taken for nobody."""
        return [(topics.IMAGE, lambda: message_builders.image(at, take()))]

    def reference(self, values: DecidedValues, sensed: SensedValues) -> Said:
        """The attitude reference, once decided; who follows it hears the first attitude after it."""
        if not self._attitude_is_external:
            return
        at, points = nanoseconds(float(values.tick.time_s)), map(np.asarray, values.reference)
        yield live_topics.ATTITUDE_REFERENCE, partial(live_topics.attitude_reference, at, self._step_ns, *points)
        if not self._formation_is_external:
            yield _attitude(at, sensed.attitude)

    def decided(self, values: DecidedValues) -> Said:
        """Once all is decided: what flight software is up to."""
        return message_builders.of_tick(values.tick, _DECIDED)

    def step(self, at: int, values: AttitudeValues) -> Said:
        """Before a plant step within a tick whose torques come from outside."""
        variance = float(values.gyro_variance)
        return [
            (topics.CLOCK, partial(message_builders.clock, at)),
            (topics.WHEELS, partial(message_builders.wheels, at, np.asarray(values.wheel_speed), np.zeros(0))),
            _attitude(at, values),
            (topics.IMU, partial(message_builders.imu, at, np.asarray(values.gyro), variance)),
        ]


def _attitude(at: int, values: AttitudeValues) -> tuple[Topic, Callable[[], Any]]:
    now = values.orientation, values.rate, values.covariance, values.rate_covariance
    return live_topics.ATTITUDE_ESTIMATE, partial(live_topics.attitude_estimate, at, *map(np.asarray, now))
