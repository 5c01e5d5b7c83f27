"""What a live run says at each point of a tick."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.core.pytree import pytree
from rpojax.flight.computer import Stages
from rpojax.interop import live_topics, messages, tick_values, topics
from rpojax.interop.frames import orientation, rotation, turned
from rpojax.interop.live_settings import Settings, Stage
from rpojax.interop.messages import Said, nanoseconds
from rpojax.interop.tick_values import TickValues
from rpojax.simulation import stepwise
from rpojax.simulation.params import Params
from rpojax.simulation.run_state import State, Telemetry
from rpojax.simulation.scenario import Scenario
from rpojax.simulation.stepwise import Begun, Decided
from rpojax.simulation.tick_stages import Motion

_LATER = (topics.TARGET_ESTIMATE, topics.WHEEL_COMMAND, topics.THRUSTER_COMMAND, topics.DIAGNOSTICS)
"""Said when the flight software has decided."""


@pytree
class AttitudeValues:
    """The attitude in the middle of a tick.

    Attributes:
        orientation: (4,) x, y, z, w of the servicer in `eci`, estimated
        rate: (3,) estimated [rad/s]
        covariance: (3, 3) of the orientation in `eci`, at the beginning of the tick [rad^2]
        rate_covariance: (3, 3) [rad^2/s^2]
        gyro: (3,) sample [rad/s]
        wheel_speed: (3,) [rad/s]
    """

    orientation: jax.Array
    rate: jax.Array
    covariance: jax.Array
    rate_covariance: jax.Array
    gyro: jax.Array
    wheel_speed: jax.Array


class Words:
    """Makes the messages of one run."""

    def __init__(self, settings: Settings, scenario: Scenario, params: Params) -> None:
        self._settings, self._scenario, self._params = settings, scenario, params
        self._gyro_variance = float(params.flight.attitude_filter.angle_random_walk) ** 2 / scenario.step_s

    def sensed(self, state: State, begun: Begun) -> Said:
        """At the beginning of a tick: time, truth, measurements, and what navigation makes of them."""
        values = jax.device_get(_values(self._scenario, self._params, begun.seen))
        at = nanoseconds(values.time_s)
        said = [(topic, message) for topic, message in messages.of_tick(values) if topic not in _LATER]
        if int(state.tick) == 0:
            said.insert(0, (topics.TF_STATIC, messages.camera_mounting(at, values)))
        if Stage.ATTITUDE in self._settings.external:
            # The motors' torques are not decided yet.
            wheels = messages.wheels(at, values.wheel_speed, np.zeros(0))
            said = [(topic, wheels if topic is topics.WHEELS else message) for topic, message in said]
        if self._scenario.camera_model == "rendered" and self._settings.pictures:
            window = begun.sensed.frame.window
            picture = np.asarray(stepwise.picture(self._scenario, self._params, state, window))
            said.append((topics.IMAGE, messages.image(at, picture)))
        return said

    def decided(self, decided: Decided) -> Said:
        """Once burn and attitude reference are decided: what flight software is up to."""
        values = jax.device_get(_values(self._scenario, self._params, decided.seen))
        at = nanoseconds(values.time_s)
        said = [(topic, message) for topic, message in messages.of_tick(values) if topic in _LATER]
        if Stage.ATTITUDE in self._settings.external:
            command = jax.device_get(_reference(self._scenario, decided))
            step = nanoseconds(self._scenario.step_s)
            said.append((live_topics.ATTITUDE_REFERENCE, live_topics.attitude_reference(at, step, *command)))
        return said

    def step(self, at: int, motion: Motion, decided: Decided, first: bool) -> Said:
        """Before a plant step whose torques come from outside; the `first` of a tick repeats nothing."""
        values = jax.device_get(_step(motion, decided, self._gyro_variance))
        estimate = live_topics.attitude_estimate(
            at, values.orientation, values.rate, values.covariance, values.rate_covariance
        )
        again = [
            (topics.CLOCK, messages.clock(at)),
            (topics.IMU, messages.imu(at, values.gyro, self._gyro_variance)),
            (topics.WHEELS, messages.wheels(at, values.wheel_speed, np.zeros(0))),
        ]
        return [*([] if first else again), (live_topics.ATTITUDE_ESTIMATE, estimate)]


@partial(jax.jit, static_argnums=0)
def _values(scenario: Scenario, params: Params, seen: Telemetry) -> TickValues:
    return tick_values.observe(Stages(), scenario, params, seen)


@partial(jax.jit, static_argnums=0)
def _reference(scenario: Scenario, decided: Decided) -> tuple[jax.Array, jax.Array, jax.Array]:
    command = stepwise.reference(scenario, decided)
    return jax.vmap(orientation)(command.q_CN), command.omega_CN_C, command.acceleration_C


@jax.jit
def _step(motion: Motion, decided: Decided, gyro_variance: jax.Array) -> AttitudeValues:
    attitude, P = motion.attitude, decided.flight.attitude.covariance
    return AttitudeValues(
        orientation=orientation(attitude.q_BN),
        rate=attitude.omega_BN_B,
        covariance=turned(rotation(attitude.q_BN).T, P[:3, :3]),
        rate_covariance=P[3:, 3:] + gyro_variance * jnp.eye(3),
        gyro=attitude.gyro_B,
        wheel_speed=motion.truth.wheel_speed,
    )
