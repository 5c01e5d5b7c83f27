"""The stages of a live run's tick as compiled functions of few arrays, with what there is to say after each."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.core import quaternion
from rpojax.core.array_packing import Bundle, Layout, Packed
from rpojax.core.pytree import pytree
from rpojax.flight.computer import Stages
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.interop.ros2 import message_values
from rpojax.interop.ros2.frame_names import orientation, turned
from rpojax.interop.ros2.message_values import TickValues
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.simulation import external_stages, step_stages, telemetry
from rpojax.simulation.external_stages import Begun, Decider, GivenBurn, GivenOrbit
from rpojax.simulation.state import State
from rpojax.simulation.step_stages import Decided, Motion
from rpojax.simulation.telemetry import Channels

_STAGES = Stages()


@pytree
class AttitudeValues:
    """The attitude before a plant step.

    Attributes:
        orientation: (4,) x, y, z, w of the servicer in `eci`, estimated
        rate: (3,) estimated [rad/s]
        covariance: (3, 3) of the orientation in `eci`, at the beginning of the tick [rad^2]
        rate_covariance: (3, 3) [rad^2/s^2]
        gyro: (3,) sample [rad/s]
        gyro_variance: () of it per axis [rad^2/s^2]
        wheel_speed: (3,) [rad/s]
    """

    orientation: jax.Array
    rate: jax.Array
    covariance: jax.Array
    rate_covariance: jax.Array
    gyro: jax.Array
    gyro_variance: jax.Array
    wheel_speed: jax.Array


@pytree
class SensedValues:
    """What there is to say once a tick has been sensed and navigated.

    Attributes:
        tick: values of the tick
        attitude: before the first plant step
    """

    tick: TickValues
    attitude: AttitudeValues


@pytree
class DecidedValues:
    """What there is to say once burn and pointing are decided.

    Attributes:
        tick: values of the tick
        channels: its record
        reference: orientations (n, 4) x, y, z, w, rates (n, 3) [rad/s] and accelerations (n, 3) [rad/s^2]
    """

    tick: TickValues
    channels: Channels
    reference: tuple[jax.Array, jax.Array, jax.Array]


@dataclass(frozen=True)
class Opened:
    """A tick that has been sensed and navigated.

    Attributes:
        state: at its beginning, for the program alone
        begun: what has come of it, for the program alone
        values: what there is to say
        failure: code of the run's failure so far
    """

    state: Bundle
    begun: Bundle
    values: SensedValues
    failure: int


class Program:
    """One run between two things that are said; the end of a tick is one function with the beginning of the next."""

    def __init__(self, scenario: Scenario, params: Params) -> None:
        held = Bundle.of(params)
        self._params = Bundle(held.layout, tuple(map(jnp.asarray, held.arrays)))
        self._open = Packed(partial(_open, scenario))
        self._adopt = Packed(_adopt)
        self._decide: dict[Decider, Packed] = {}
        self._move = Packed(partial(_move, scenario))
        self._close = Packed(partial(_close, scenario))
        self._close_alone = Packed(partial(_close_alone, scenario))
        self._picture = Packed(partial(_picture, scenario))
        self._scenario = scenario

    def open(self, state: State) -> Opened:
        """The first tick."""
        return _opened(*self._open(self._params, Bundle.of(state)))

    def adopt(self, tick: Opened, given: GivenOrbit) -> Opened:
        """The tick with somebody else's navigation."""
        return replace(tick, begun=self._adopt(tick.begun, Bundle.of(given))[0])

    def decide(self, decider: Decider, tick: Opened, burn: GivenBurn) -> tuple[Bundle, Bundle, DecidedValues]:
        """Burn and pointing, the motion before the first plant step, and what there is to say."""
        if decider not in self._decide:
            self._decide[decider] = Packed(partial(_decide, self._scenario, decider))
        decided, motion, values = self._decide[decider](self._params, tick.state, tick.begun, Bundle.of(burn))
        return decided, motion, values.fetch()

    def move(
        self, tick: Opened, decided: Bundle, motion: Bundle, torque: np.ndarray, step: int
    ) -> tuple[Bundle, AttitudeValues]:
        """One plant step under given torques [N m], and the attitude after it."""
        motion, values = self._move(self._params, tick.state, decided, motion, _order(torque, step))
        return motion, values.fetch()

    def close(self, tick: Opened, decided: Bundle, motion: Bundle, torque: np.ndarray, step: int) -> Opened:
        """The last plant step of a tick under given torques [N m], and the next tick."""
        return _opened(*self._close(self._params, tick.state, decided, motion, _order(torque, step)))

    def close_alone(self, tick: Opened, decided: Bundle) -> Opened:
        """All plant steps of a tick under the flight software's own torques, and the next tick."""
        return _opened(*self._close_alone(self._params, tick.state, decided))

    def picture(self, tick: Opened) -> np.ndarray:
        """The picture that the detector of a rendered camera gets."""
        return self._picture(self._params, tick.state, tick.begun)[0].fetch()


_ORDER = Layout.of((np.zeros(3), np.int32(0)))


def _order(torque: np.ndarray, step: int) -> Bundle:
    """As `Bundle.of` makes it, which would look at the shapes at every plant step."""
    return Bundle(_ORDER, (torque, np.array([step], dtype=np.int32)))


def _opened(state: Bundle, begun: Bundle, values: Bundle, failure: Bundle) -> Opened:
    return Opened(state, begun, values.fetch(), int(failure.fetch()))


def _open(scenario: Scenario, params: Params, state: State) -> tuple[State, Begun, SensedValues, jax.Array]:
    begun = external_stages.begin(_STAGES, scenario, params, state)
    # There is no mode before guidance.
    mode = jnp.zeros((), dtype=jnp.int64)
    seen = step_stages.look(state, begun.sensed, begun.flight, begun.innovation, mode)
    attitude = begun.flight.attitude
    values = SensedValues(
        tick=message_values.observe(_STAGES, scenario, params, seen),
        attitude=_attitude(scenario, params, attitude, attitude, state.truth.wheel_speed),
    )
    return state, begun, values, state.failure


def _picture(scenario: Scenario, params: Params, state: State, begun: Begun) -> tuple[jax.Array]:
    return (external_stages.picture(scenario, params, state, begun.sensed.frame.window),)


def _adopt(begun: Begun, given: GivenOrbit) -> tuple[Begun]:
    return (external_stages.adopt(begun, given),)


def _decide(
    scenario: Scenario, decider: Decider, params: Params, state: State, begun: Begun, burn: GivenBurn
) -> tuple[Decided, Motion, DecidedValues]:
    decided, seen = external_stages.decide(_STAGES, scenario, decider, params, state, begun, burn)
    motion = step_stages.set_off(state, decided)
    command = external_stages.reference(scenario, decided)
    values = DecidedValues(
        tick=message_values.observe(_STAGES, scenario, params, seen),
        channels=telemetry.observe(scenario, params, seen),
        reference=(jax.vmap(orientation)(command.q_CN), command.omega_CN_C, command.acceleration_C),
    )
    return decided, motion, values


def _move(
    scenario: Scenario,
    params: Params,
    state: State,
    decided: Decided,
    motion: Motion,
    order: tuple[jax.Array, jax.Array],
) -> tuple[Motion, AttitudeValues]:
    motion = external_stages.move(scenario, params, state, decided, motion, *order)
    held, wheels = decided.flight.attitude, motion.truth.wheel_speed
    return motion, _attitude(scenario, params, held, motion.attitude, wheels)


def _close(
    scenario: Scenario,
    params: Params,
    state: State,
    decided: Decided,
    motion: Motion,
    order: tuple[jax.Array, jax.Array],
) -> tuple[State, Begun, SensedValues, jax.Array]:
    motion, _ = _move(scenario, params, state, decided, motion, order)
    return _open(scenario, params, external_stages.finish(_STAGES, scenario, params, state, decided, motion))


def _close_alone(
    scenario: Scenario, params: Params, state: State, decided: Decided
) -> tuple[State, Begun, SensedValues, jax.Array]:
    motion = external_stages.move_all(_STAGES, scenario, params, state, decided)
    return _open(scenario, params, external_stages.finish(_STAGES, scenario, params, state, decided, motion))


def _attitude(
    scenario: Scenario, params: Params, held: AttitudeEstimate, now: AttitudeEstimate, wheel_speed: jax.Array
) -> AttitudeValues:
    """Values of the estimate `now`, with the covariance `held` since the beginning of the tick."""
    noise = message_values.gyro_variance(scenario, params)
    return AttitudeValues(
        orientation=orientation(now.q_BN),
        rate=now.omega_BN_B,
        covariance=turned(quaternion.to_matrix(now.q_BN).T, held.covariance[:3, :3]),
        rate_covariance=message_values.rate_covariance(held, noise),
        gyro=now.gyro_B,
        gyro_variance=noise,
        wheel_speed=wheel_speed,
    )
