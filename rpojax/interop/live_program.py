"""The stages of a live run's tick as compiled functions of few arrays, with what there is to say after each."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.core import quaternion
from rpojax.core.packing import Bundle, Packed
from rpojax.core.pytree import pytree
from rpojax.flight.computer import Stages
from rpojax.interop import tick_values
from rpojax.interop.frames import orientation, turned
from rpojax.interop.tick_values import TickValues
from rpojax.simulation import stepwise, telemetry, tick_stages
from rpojax.simulation.params import Params
from rpojax.simulation.run_state import State
from rpojax.simulation.scenario import Scenario
from rpojax.simulation.stepwise import Begun, Decider, GivenBurn, GivenOrbit
from rpojax.simulation.telemetry import Channels
from rpojax.simulation.tick_stages import Decided, Motion

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
class DecidedValues:
    """What there is to say once burn and pointing are decided.

    Attributes:
        tick: values of the tick
        channels: its record
        reference: orientations (n, 4) x, y, z, w, rates (n, 3) [rad/s] and accelerations (n, 3) [rad/s^2]
        attitude: before the first plant step
    """

    tick: TickValues
    channels: Channels
    reference: tuple[jax.Array, jax.Array, jax.Array]
    attitude: AttitudeValues


class Program:
    """One run between two things that are said.

    What is handed from one function to the next is for them alone.
    """

    def __init__(self, scenario: Scenario, params: Params) -> None:
        held = Bundle.of(params)
        self._params = Bundle(held.layout, tuple(map(jnp.asarray, held.arrays)))
        self._begin = Packed(partial(_begin, scenario))
        self._adopt = Packed(_adopt)
        self._decide: dict[Decider, Packed] = {}
        self._move = Packed(partial(_move, scenario))
        self._move_all = Packed(partial(_move_all, scenario))
        self._finish = Packed(partial(_finish, scenario))
        self._picture = Packed(partial(_picture, scenario))
        self._scenario = scenario

    def begin(self, state: Bundle) -> tuple[Bundle, TickValues]:
        """Sensing and navigation."""
        begun, values = self._begin(self._params, state)
        return begun, values.fetch()

    def adopt(self, begun: Bundle, given: GivenOrbit) -> Bundle:
        """Somebody else's navigation."""
        return self._adopt(begun, Bundle.of(given))[0]

    def decide(
        self, decider: Decider, state: Bundle, begun: Bundle, burn: GivenBurn
    ) -> tuple[Bundle, Bundle, DecidedValues]:
        """Burn and pointing, and the motion before the first plant step."""
        if decider not in self._decide:
            self._decide[decider] = Packed(partial(_decide, self._scenario, decider))
        decided, motion, values = self._decide[decider](self._params, state, begun, Bundle.of(burn))
        return decided, motion, values.fetch()

    def move(
        self, state: Bundle, decided: Bundle, motion: Bundle, torque: np.ndarray, step: int
    ) -> tuple[Bundle, AttitudeValues]:
        """One plant step under given torques [N m], and the attitude after it."""
        order = Bundle.of((torque, np.int32(step)))
        motion, values = self._move(self._params, state, decided, motion, order)
        return motion, values.fetch()

    def move_all(self, state: Bundle, decided: Bundle) -> Bundle:
        """All plant steps of a tick under the flight software's own torques."""
        return self._move_all(self._params, state, decided)[0]

    def finish(self, state: Bundle, decided: Bundle, motion: Bundle) -> tuple[Bundle, int]:
        """State one tick later, and the code of its failure."""
        after, failure = self._finish(self._params, state, decided, motion)
        return after, int(failure.fetch())

    def picture(self, state: Bundle, begun: Bundle) -> np.ndarray:
        """The picture that the detector of a rendered camera gets."""
        return self._picture(self._params, state, begun)[0].fetch()


def _begin(scenario: Scenario, params: Params, state: State) -> tuple[Begun, TickValues]:
    begun = stepwise.begin(_STAGES, scenario, params, state)
    # There is no mode before guidance.
    mode = jnp.zeros((), dtype=jnp.int64)
    seen = tick_stages.look(state, begun.sensed, begun.flight, begun.innovation, mode)
    return begun, tick_values.observe(_STAGES, scenario, params, seen)


def _picture(scenario: Scenario, params: Params, state: State, begun: Begun) -> tuple[jax.Array]:
    return (stepwise.picture(scenario, params, state, begun.sensed.frame.window),)


def _adopt(begun: Begun, given: GivenOrbit) -> tuple[Begun]:
    return (stepwise.adopt(begun, given),)


def _decide(
    scenario: Scenario, decider: Decider, params: Params, state: State, begun: Begun, burn: GivenBurn
) -> tuple[Decided, Motion, DecidedValues]:
    decided, seen = stepwise.decide(_STAGES, scenario, decider, params, state, begun, burn)
    motion = tick_stages.set_off(state, decided)
    command = stepwise.reference(scenario, decided)
    values = DecidedValues(
        tick=tick_values.observe(_STAGES, scenario, params, seen),
        channels=telemetry.observe(scenario, params, seen),
        reference=(jax.vmap(orientation)(command.q_CN), command.omega_CN_C, command.acceleration_C),
        attitude=_attitude(scenario, params, decided, motion),
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
    motion = stepwise.move(scenario, params, state, decided, motion, *order)
    return motion, _attitude(scenario, params, decided, motion)


def _move_all(scenario: Scenario, params: Params, state: State, decided: Decided) -> tuple[Motion]:
    return (stepwise.move_all(_STAGES, scenario, params, state, decided),)


def _finish(
    scenario: Scenario, params: Params, state: State, decided: Decided, motion: Motion
) -> tuple[State, jax.Array]:
    after = stepwise.finish(_STAGES, scenario, params, state, decided, motion)
    return after, after.failure


def _attitude(scenario: Scenario, params: Params, decided: Decided, motion: Motion) -> AttitudeValues:
    attitude, predicted = motion.attitude, decided.flight.attitude
    noise = tick_values.gyro_variance(scenario, params)
    return AttitudeValues(
        orientation=orientation(attitude.q_BN),
        rate=attitude.omega_BN_B,
        covariance=turned(quaternion.to_matrix(attitude.q_BN).T, predicted.covariance[:3, :3]),
        rate_covariance=tick_values.rate_covariance(predicted, noise),
        gyro=attitude.gyro_B,
        gyro_variance=noise,
        wheel_speed=motion.truth.wheel_speed,
    )
