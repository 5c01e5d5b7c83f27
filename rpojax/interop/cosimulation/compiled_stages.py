"""The stages of a live run's tick as compiled functions of few arrays, with what there is to say after each."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.core import quaternion
from rpojax.core.array_packing import PackedFunction, PackedLayout, PackedRecord
from rpojax.core.pytree import pytree
from rpojax.flight.computer import Stages
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.interop.ros2 import message_values
from rpojax.interop.ros2.frame_names import orientation_from_quaternion, rotate_covariance
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.simulation import external_stages, step_stages, telemetry
from rpojax.simulation.external_stages import BurnDecider, ExternalBurn, ExternalOrbitEstimate, NavigatedTick
from rpojax.simulation.state import State
from rpojax.simulation.step_stages import GuidedTick, Motion
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
class NavigatedValues:
    """What there is to say once a tick has been sensed and navigated.

    Attributes:
        tick: values of the tick
        attitude: before the first plant step
    """

    tick: RosTickValues
    attitude: AttitudeValues


@pytree
class GuidedValues:
    """What there is to say once burn and pointing are decided.

    Attributes:
        tick: values of the tick
        channels: its record
        reference: orientations (n, 4) x, y, z, w, rates (n, 3) [rad/s] and accelerations (n, 3) [rad/s^2]
    """

    tick: RosTickValues
    channels: Channels
    attitude_reference: tuple[jax.Array, jax.Array, jax.Array]


@dataclass(frozen=True)
class PackedTick:
    """A tick that has been sensed and navigated.

    Attributes:
        state: at its beginning, for the program alone
        begun: what has come of it, for the program alone
        values: what there is to say
        failure: code of the run's failure so far
    """

    state: PackedRecord
    navigated: PackedRecord
    values: NavigatedValues
    failure: int


class CompiledStages:
    """One run between two things that are said; the end of a tick is one function with the beginning of the next."""

    def __init__(self, scenario: Scenario, params: Params) -> None:
        packed = PackedRecord.of(params)
        self._params = PackedRecord(packed.layout, tuple(map(jnp.asarray, packed.arrays)))
        self._sense_and_navigate = PackedFunction(partial(_sense_and_navigate, scenario))
        self._replace_orbit = PackedFunction(_replace_orbit)
        self._plan_and_guide: dict[BurnDecider, PackedFunction] = {}
        self._plant_step = PackedFunction(partial(_plant_step, scenario))
        self._last_plant_step = PackedFunction(partial(_last_plant_step, scenario))
        self._all_plant_steps = PackedFunction(partial(_all_plant_steps, scenario))
        self._camera_image = PackedFunction(partial(_camera_image, scenario))
        self._scenario = scenario

    def first_tick(self, state: State) -> PackedTick:
        """The first tick."""
        return _fetch_tick(*self._sense_and_navigate(self._params, PackedRecord.of(state)))

    def with_orbit_estimate(self, tick: PackedTick, estimate: ExternalOrbitEstimate) -> PackedTick:
        """The tick with somebody else's navigation."""
        return replace(tick, navigated=self._replace_orbit(tick.navigated, PackedRecord.of(estimate))[0])

    def plan_and_guide(
        self, decider: BurnDecider, tick: PackedTick, burn: ExternalBurn
    ) -> tuple[PackedRecord, PackedRecord, GuidedValues]:
        """Burn and pointing, the motion before the first plant step, and what there is to say."""
        if decider not in self._plan_and_guide:
            self._plan_and_guide[decider] = PackedFunction(partial(_plan_and_guide, self._scenario, decider))
        guided, motion, values = self._plan_and_guide[decider](
            self._params, tick.state, tick.navigated, PackedRecord.of(burn)
        )
        return guided, motion, values.to_numpy()

    def plant_step(
        self, tick: PackedTick, guided: PackedRecord, motion: PackedRecord, torque: np.ndarray, step: int
    ) -> tuple[PackedRecord, AttitudeValues]:
        """One plant step under given torques [N m], and the attitude after it."""
        motion, values = self._plant_step(self._params, tick.state, guided, motion, _pack_torque(torque, step))
        return motion, values.to_numpy()

    def last_plant_step(
        self, tick: PackedTick, guided: PackedRecord, motion: PackedRecord, torque: np.ndarray, step: int
    ) -> PackedTick:
        """The last plant step of a tick under given torques [N m], and the next tick."""
        return _fetch_tick(*self._last_plant_step(self._params, tick.state, guided, motion, _pack_torque(torque, step)))

    def all_plant_steps(self, tick: PackedTick, guided: PackedRecord) -> PackedTick:
        """All plant steps of a tick under the flight software's own torques, and the next tick."""
        return _fetch_tick(*self._all_plant_steps(self._params, tick.state, guided))

    def camera_image(self, tick: PackedTick) -> np.ndarray:
        """The picture that the detector of a rendered camera gets."""
        return self._camera_image(self._params, tick.state, tick.navigated)[0].to_numpy()


_TORQUE_AND_STEP = PackedLayout.of((np.zeros(3), np.int32(0)))


def _pack_torque(torque: np.ndarray, step: int) -> PackedRecord:
    """As `Bundle.of` makes it, which would look at the shapes at every plant step."""
    return PackedRecord(_TORQUE_AND_STEP, (torque, np.array([step], dtype=np.int32)))


def _fetch_tick(
    state: PackedRecord, navigated: PackedRecord, values: PackedRecord, failure: PackedRecord
) -> PackedTick:
    return PackedTick(state, navigated, values.to_numpy(), int(failure.to_numpy()))


def _sense_and_navigate(
    scenario: Scenario, params: Params, state: State
) -> tuple[State, NavigatedTick, NavigatedValues, jax.Array]:
    navigated = external_stages.sense_and_navigate(_STAGES, scenario, params, state)
    # There is no mode before guidance.
    mode = jnp.zeros((), dtype=jnp.int64)
    telemetry_record = step_stages.make_telemetry(state, navigated.sensed, navigated.flight, navigated.innovation, mode)
    attitude = navigated.flight.attitude
    values = NavigatedValues(
        tick=message_values.observe_tick(_STAGES, scenario, params, telemetry_record),
        attitude=_attitude_values(scenario, params, attitude, attitude, state.truth.wheel_speed),
    )
    return state, navigated, values, state.failure


def _camera_image(scenario: Scenario, params: Params, state: State, navigated: NavigatedTick) -> tuple[jax.Array]:
    return (external_stages.detector_picture(scenario, params, state, navigated.sensed.frame.window),)


def _replace_orbit(navigated: NavigatedTick, estimate: ExternalOrbitEstimate) -> tuple[NavigatedTick]:
    return (external_stages.replace_orbit_estimate(navigated, estimate),)


def _plan_and_guide(
    scenario: Scenario, decider: BurnDecider, params: Params, state: State, navigated: NavigatedTick, burn: ExternalBurn
) -> tuple[GuidedTick, Motion, GuidedValues]:
    guided, telemetry_record = external_stages.plan_burn_and_guide(
        _STAGES, scenario, decider, params, state, navigated, burn
    )
    motion = step_stages.initial_motion(state, guided)
    reference = external_stages.attitude_commands(scenario, guided)
    values = GuidedValues(
        tick=message_values.observe_tick(_STAGES, scenario, params, telemetry_record),
        channels=telemetry.compute_channels(scenario, params, telemetry_record),
        attitude_reference=(
            jax.vmap(orientation_from_quaternion)(reference.q_CN),
            reference.omega_CN_C,
            reference.acceleration_C,
        ),
    )
    return guided, motion, values


def _plant_step(
    scenario: Scenario,
    params: Params,
    state: State,
    guided: GuidedTick,
    motion: Motion,
    torque_and_step: tuple[jax.Array, jax.Array],
) -> tuple[Motion, AttitudeValues]:
    motion = external_stages.propagate_substep(scenario, params, state, guided, motion, *torque_and_step)
    tick_estimate, wheels = guided.flight.attitude, motion.truth.wheel_speed
    return motion, _attitude_values(scenario, params, tick_estimate, motion.attitude, wheels)


def _last_plant_step(
    scenario: Scenario,
    params: Params,
    state: State,
    guided: GuidedTick,
    motion: Motion,
    torque_and_step: tuple[jax.Array, jax.Array],
) -> tuple[State, NavigatedTick, NavigatedValues, jax.Array]:
    motion, _ = _plant_step(scenario, params, state, guided, motion, torque_and_step)
    return _sense_and_navigate(
        scenario, params, external_stages.finish(_STAGES, scenario, params, state, guided, motion)
    )


def _all_plant_steps(
    scenario: Scenario, params: Params, state: State, guided: GuidedTick
) -> tuple[State, NavigatedTick, NavigatedValues, jax.Array]:
    motion = external_stages.control_and_propagate(_STAGES, scenario, params, state, guided)
    return _sense_and_navigate(
        scenario, params, external_stages.finish(_STAGES, scenario, params, state, guided, motion)
    )


def _attitude_values(
    scenario: Scenario,
    params: Params,
    tick_estimate: AttitudeEstimate,
    current: AttitudeEstimate,
    wheel_speed: jax.Array,
) -> AttitudeValues:
    """Values of the estimate `now`, with the covariance `held` since the beginning of the tick."""
    gyro_noise = message_values.gyro_variance(scenario, params)
    return AttitudeValues(
        orientation=orientation_from_quaternion(current.q_BN),
        rate=current.omega_BN_B,
        covariance=rotate_covariance(quaternion.to_matrix(current.q_BN).T, tick_estimate.covariance[:3, :3]),
        rate_covariance=message_values.rate_covariance(tick_estimate, gyro_noise),
        gyro=current.gyro_B,
        gyro_variance=gyro_noise,
        wheel_speed=wheel_speed,
    )
