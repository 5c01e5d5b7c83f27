"""What a live run says at each point of a tick."""

import numpy as np

from rpojax.interop import live_topics, messages, topics
from rpojax.interop.live_program import AttitudeValues, DecidedValues
from rpojax.interop.live_settings import Settings, Stage
from rpojax.interop.messages import Said, nanoseconds
from rpojax.interop.tick_values import TickValues

_DECIDED = frozenset((topics.TARGET_ESTIMATE, topics.WHEEL_COMMAND, topics.THRUSTER_COMMAND, topics.DIAGNOSTICS))
"""Said when the flight software has decided."""
_SENSED = frozenset(topics.TABLE) - _DECIDED


class Words:
    """Makes the messages of one run; `step_ns` is that of the plant [ns]."""

    def __init__(self, settings: Settings, step_ns: int) -> None:
        self._attitude_is_external = Stage.ATTITUDE in settings.external
        self._step_ns = step_ns

    def sensed(self, values: TickValues, picture: np.ndarray | None) -> Said:
        """At the beginning of a tick: time, truth, measurements, and what navigation makes of them."""
        at = nanoseconds(float(values.time_s))
        said = messages.of_tick(values, _SENSED)
        if at == 0:
            said.insert(0, (topics.TF_STATIC, messages.camera_mounting(at, values)))
        if self._attitude_is_external:
            # The motors' torques are not decided yet.
            wheels = messages.wheels(at, np.asarray(values.wheel_speed), np.zeros(0))
            said = [(topic, wheels if topic.name == topics.WHEELS.name else message) for topic, message in said]
        if picture is not None:
            said.append((topics.IMAGE, messages.image(at, picture)))
        return said

    def decided(self, values: DecidedValues) -> Said:
        """Once burn and attitude reference are decided: what flight software is up to."""
        at = nanoseconds(float(values.tick.time_s))
        said = messages.of_tick(values.tick, _DECIDED)
        if self._attitude_is_external:
            reference = live_topics.attitude_reference(at, self._step_ns, *map(np.asarray, values.reference))
            said.append((live_topics.ATTITUDE_REFERENCE, reference))
        return said

    def step(self, at: int, values: AttitudeValues, first: bool) -> Said:
        """Before a plant step whose torques come from outside; the `first` of a tick repeats nothing."""
        turn, rate, P, P_rate = map(
            np.asarray, (values.orientation, values.rate, values.covariance, values.rate_covariance)
        )
        said: Said = []
        if not first:
            variance = float(values.gyro_variance)
            said = [
                (topics.CLOCK, messages.clock(at)),
                (topics.IMU, messages.imu(at, np.asarray(values.gyro), variance)),
                (topics.WHEELS, messages.wheels(at, np.asarray(values.wheel_speed), np.zeros(0))),
            ]
        return [*said, (live_topics.ATTITUDE_ESTIMATE, live_topics.attitude_estimate(at, turn, rate, P, P_rate))]
