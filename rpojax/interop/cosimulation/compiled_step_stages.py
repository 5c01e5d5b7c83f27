"""Compiled stages of a live run's tick, on packed arrays, each with the values of its messages.

The end of a tick and the beginning of the next are one compiled function. Each array that goes in or out costs time, so
records are packed.
"""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.core import quaternion
from rpojax.core.array_packing import PackedFunction, PackedLayout, PackedRecord
from rpojax.core.pytree import pytree
from rpojax.flight.guidance.burn_schedule import ExternalBurn
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.stages import Stages
from rpojax.interop.ros2 import message_values
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.ros2.odometry import orientation_from_quaternion, rate_covariance, rotate_covariance
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import external_inputs, step_stages
from rpojax.simulation.channels import Channels, compute_channels
from rpojax.simulation.external_inputs import ExternalOrbitEstimate
from rpojax.simulation.state import State
from rpojax.simulation.telemetry import telemetry_of
from rpojax.simulation.tick import Loop, Motion, Tick

_TORQUE_AND_STEP = PackedLayout.of((np.zeros(3), np.int32(0)))


@pytree
class AttitudeValues:
    """Attitude values before a plant step.

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
    """Message values after sensing and navigation.

    Attributes:
        tick: values of the tick
        attitude: before the first plant step
    """

    tick: RosTickValues
    attitude: AttitudeValues


@pytree
class GuidedValues:
    """Message values after burn planning and guidance.

    Attributes:
        tick: values of the tick
        channels: telemetry channels of the tick
        attitude_reference: orientations (n, 4) x, y, z, w, rates (n, 3) [rad/s] and accelerations (n, 3) [rad/s^2]
    """

    tick: RosTickValues
    channels: Channels
    attitude_reference: tuple[jax.Array, jax.Array, jax.Array]


@dataclass(frozen=True)
class PackedTick:
    """Tick after sensing and navigation.

    Attributes:
        tick: packed `Tick`
        values: message values
        failure: code of the run's failure so far
    """

    tick: PackedRecord
    values: NavigatedValues
    failure: int


class CompiledStages:
    """Stages of a run, between which messages are exchanged; `external_burns` replace the flight software's burns."""

    def __init__(self, scenario: Scenario, stages: Stages, params: Params, external_burns: bool) -> None:
        packed = PackedRecord.of(params)
        self._params = PackedRecord(packed.layout, tuple(map(jnp.asarray, packed.arrays)))
        self._begin_tick = PackedFunction(partial(_begin_tick, scenario, stages))
        self._replace_orbit = PackedFunction(_replace_orbit)
        self._plan_and_guide = PackedFunction(partial(_plan_and_guide, scenario, stages, external_burns))
        self._plant_step = PackedFunction(partial(_plant_step, scenario, stages))
        self._last_plant_step = PackedFunction(partial(_last_plant_step, scenario, stages))
        self._all_plant_steps = PackedFunction(partial(_all_plant_steps, scenario, stages))
        self._camera_image = PackedFunction(partial(_camera_image, scenario, stages))

    def first_tick(self, state: State) -> PackedTick:
        """The first tick."""
        return _fetch_tick(*self._begin_tick(self._params, PackedRecord.of(state)))

    def with_orbit_estimate(self, tick: PackedTick, estimate: ExternalOrbitEstimate) -> PackedTick:
        """The tick with an external orbit estimate."""
        return replace(tick, tick=self._replace_orbit(tick.tick, PackedRecord.of(estimate))[0])

    def plan_and_guide(self, tick: PackedTick, burn: ExternalBurn) -> tuple[PackedRecord, PackedRecord, GuidedValues]:
        """The tick after guidance, the motion before the first plant step, and the message values.

        `burn` counts only with external burns.
        """
        guided, motion, values = self._plan_and_guide(self._params, tick.tick, PackedRecord.of(burn))
        return guided, motion, values.to_numpy()

    def plant_step(
        self, guided: PackedRecord, motion: PackedRecord, torque: np.ndarray, step: int
    ) -> tuple[PackedRecord, AttitudeValues]:
        """One plant step under external torques (3,) [N m]: the motion and attitude after it."""
        motion, values = self._plant_step(self._params, guided, motion, _pack_torque(torque, step))
        return motion, values.to_numpy()

    def last_plant_step(self, guided: PackedRecord, motion: PackedRecord, torque: np.ndarray, step: int) -> PackedTick:
        """The next tick, after the last plant step under external torques (3,) [N m]."""
        return _fetch_tick(*self._last_plant_step(self._params, guided, motion, _pack_torque(torque, step)))

    def all_plant_steps(self, guided: PackedRecord) -> PackedTick:
        """The next tick, after all plant steps under the torques of the flight software."""
        return _fetch_tick(*self._all_plant_steps(self._params, guided))

    def camera_image(self, tick: PackedTick) -> np.ndarray:
        """Image (p, p, 3) that the detector of a rendered camera gets, uint8 sRGB codes."""
        return self._camera_image(self._params, tick.tick)[0].to_numpy()


def _pack_torque(torque: np.ndarray, step: int) -> PackedRecord:
    """Equal to `PackedRecord.of((torque, step))` with a known layout, which is faster."""
    return PackedRecord(_TORQUE_AND_STEP, (torque, np.array([step], dtype=np.int32)))


def _fetch_tick(tick: PackedRecord, values: PackedRecord, failure: PackedRecord) -> PackedTick:
    return PackedTick(tick, values.to_numpy(), int(failure.to_numpy()))


def _begin_tick(
    scenario: Scenario, stages: Stages, params: Params, state: State
) -> tuple[Tick, NavigatedValues, jax.Array]:
    """Sensing and navigation."""
    loop = Loop(scenario, params, stages)
    tick = step_stages.navigate(loop, step_stages.sense(loop, step_stages.command_camera(loop, state)))
    # Guidance sets the mode later in the tick.
    telemetry = telemetry_of(loop, replace(tick, mode=jnp.zeros((), dtype=jnp.int64)))
    attitude = tick.flight.attitude
    values = NavigatedValues(
        tick=message_values.observe_tick(stages, scenario, params, telemetry),
        attitude=_attitude_values(scenario, params, attitude, attitude, state.truth.wheel_speed),
    )
    return tick, values, state.failure


def _camera_image(scenario: Scenario, stages: Stages, params: Params, tick: Tick) -> tuple[jax.Array]:
    return (external_inputs.detector_picture(Loop(scenario, params, stages), tick),)


def _replace_orbit(tick: Tick, estimate: ExternalOrbitEstimate) -> tuple[Tick]:
    return (external_inputs.replace_orbit_estimate(tick, estimate),)


def _plan_and_guide(
    scenario: Scenario, stages: Stages, external_burns: bool, params: Params, tick: Tick, burn: ExternalBurn
) -> tuple[Tick, Motion, GuidedValues]:
    loop = Loop(scenario, params, stages)
    tick = step_stages.manage_mission(loop, tick)
    planned = (
        external_inputs.plan_external_burn(loop, tick, burn) if external_burns else step_stages.plan_burn(loop, tick)
    )
    guided = step_stages.guide(loop, planned)
    telemetry, reference = telemetry_of(loop, guided), external_inputs.attitude_commands(loop, guided)
    values = GuidedValues(
        tick=message_values.observe_tick(stages, scenario, params, telemetry),
        channels=compute_channels(scenario, params, telemetry),
        attitude_reference=(
            jax.vmap(orientation_from_quaternion)(reference.q_CN),
            reference.omega_CN_C,
            reference.acceleration_C,
        ),
    )
    return guided, step_stages.initial_motion(guided), values


def _plant_step(
    scenario: Scenario,
    stages: Stages,
    params: Params,
    guided: Tick,
    motion: Motion,
    torque_and_step: tuple[jax.Array, jax.Array],
) -> tuple[Motion, AttitudeValues]:
    torque, step = torque_and_step
    offset, gyro_normals = step_stages.substep_offsets(scenario)[step], guided.noise.gyro[step]
    loop = Loop(scenario, params, stages)
    motion = step_stages.propagate_substep(loop, guided, motion, torque, offset, gyro_normals)
    tick_estimate, wheels = guided.flight.attitude, motion.truth.wheel_speed
    return motion, _attitude_values(scenario, params, tick_estimate, motion.attitude, wheels)


def _last_plant_step(
    scenario: Scenario,
    stages: Stages,
    params: Params,
    guided: Tick,
    motion: Motion,
    torque_and_step: tuple[jax.Array, jax.Array],
) -> tuple[Tick, NavigatedValues, jax.Array]:
    motion, _ = _plant_step(scenario, stages, params, guided, motion, torque_and_step)
    return _begin_tick(scenario, stages, params, step_stages.finish(Loop(scenario, params, stages), guided, motion))


def _all_plant_steps(
    scenario: Scenario, stages: Stages, params: Params, guided: Tick
) -> tuple[Tick, NavigatedValues, jax.Array]:
    loop = Loop(scenario, params, stages)
    motion = step_stages.control_and_propagate(loop, guided)
    return _begin_tick(scenario, stages, params, step_stages.finish(loop, guided, motion))


def _attitude_values(
    scenario: Scenario,
    params: Params,
    tick_estimate: AttitudeEstimate,
    current: AttitudeEstimate,
    wheel_speed: jax.Array,
) -> AttitudeValues:
    """Attitude values of the `current` estimate, with the covariance of `tick_estimate`."""
    gyro_noise = message_values.gyro_variance(scenario, params)
    return AttitudeValues(
        orientation=orientation_from_quaternion(current.q_BN),
        rate=current.omega_BN_B,
        covariance=rotate_covariance(quaternion.to_matrix(current.q_BN).T, tick_estimate.covariance[:3, :3]),
        rate_covariance=rate_covariance(tick_estimate, gyro_noise),
        gyro=current.gyro_B,
        gyro_variance=gyro_noise,
        wheel_speed=wheel_speed,
    )
