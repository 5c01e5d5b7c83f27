"""Derivatives of actuators, environment and plant in both modes against finite differences."""

import functools
from dataclasses import replace as static
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradient_checks import POSITION, Kernel, V, W, check, check_finite
from numpy_reference import axis_angle_quaternion
from penumbra_geometry import SUN_N, behind, touching

from rpojax.core.numerics.runge_kutta import Method
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.physics import equipment_faults, plant, plant_state, reaction_wheels, rigid_body
from rpojax.physics.environment.drag import drag
from rpojax.physics.environment.gravity_gradient_torque import gravity_gradient_torque
from rpojax.physics.environment.solar_radiation_pressure import solar_radiation_pressure, sunlit_fraction
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import PlantParams, Truth
from rpojax.physics.thruster import BurnError, ValveCommand, center_of_mass_shift, thrust_over_step
from rpojax.scenario.params import Params


@jax.jit
def torques(x: jax.Array, plant_params: PlantParams, speed: jax.Array) -> Any:
    """Accelerations of body and wheels by motor torques and gravity-gradient torque."""
    body, wheels = plant_params.servicer, plant_params.wheels
    command = jnp.array([0.01, 0.1, 0.02]) + x[:3]
    motor = reaction_wheels.limit_torque(wheels, command, speed + x[3:6], 0.2)
    hub = rigid_body.inverse_hub_inertia(body.inertia, wheels.axes, wheels.inertia)
    omega = 0.1 * V + 0.1 * x[6:9]
    torque = 1e4 * gravity_gradient_torque(POSITION + 1e6 * x[9:], body.inertia)
    found = rigid_body.accelerations_with_wheels(
        body.inertia, hub, wheels.axes, wheels.inertia, omega, speed, motor, torque
    )
    return found[0], 1e-2 * found[1]


@pytest.mark.parametrize("speed", [0.0, 627.5, 628.0], ids=["free", "near the speed limit", "at the speed limit"])
def test_derivatives_of_wheel_and_body_torques_are_right_also_when_saturated(params: Params, speed: float) -> None:
    if speed == 628.0:
        check_finite(torques, 12, params.plant, np.array([0.0, 0.0, speed]))
    else:
        check(torques, 12, params.plant, np.array([0.0, 0.0, speed]))


@jax.jit
def surface_forces(x: jax.Array, plant_params: PlantParams, r_N: jax.Array, v_N: jax.Array, sun_N: jax.Array) -> Any:
    air, sunlight, surface = plant_params.atmosphere, plant_params.sunlight, plant_params.servicer_surface
    air = replace(air, density=air.density * (1.0 + x[6]), scale_height=air.scale_height * (1.0 + x[7]))
    surface = replace(surface, area=surface.area * (1.0 + x[8]))
    r_N, v_N = r_N + 1e4 * x[:3], v_N + 1e3 * x[3:6]
    drag_acceleration = drag(air, surface, plant_params.gravity.radius, r_N, v_N)
    share = sunlit_fraction(sunlight, r_N, sun_N)
    return 1e5 * drag_acceleration, 1e6 * solar_radiation_pressure(sunlight, surface, r_N, sun_N, share)


@pytest.mark.parametrize("speed", [7.6e3, 1.0], ids=["in orbit", "nearly with the air"])
@pytest.mark.parametrize("way", [0.0, 0.4, 2.0], ids=["umbra's border", "penumbra", "light"])
def test_derivatives_of_drag_and_light_pressure_are_right(params: Params, way: float, speed: float) -> None:
    inner, outer = (touching(7.0e6, border, 6.957e8) for border in (True, False))
    r_N = behind(7.0e6, inner + way * (outer - inner))
    wind = 7.292115e-5 * np.array([-r_N[1], r_N[0], 0.0])
    compare = check_finite if way == 0.0 else check
    compare(surface_forces, 9, params.plant, r_N, wind + speed * W, SUN_N)


def test_drag_has_finite_derivatives_at_zero_airspeed(params: Params) -> None:
    still = replace(params.plant, atmosphere=replace(params.plant.atmosphere, rotation=jnp.zeros(())))
    check_finite(surface_forces, 9, still, POSITION, np.zeros(3), SUN_N)


@jax.jit
def wheel_drive(x: jax.Array, plant_params: PlantParams, command: jax.Array, speed: jax.Array) -> Any:
    wheels, speed = plant_params.wheels, speed + 10.0 * x[3:6]
    wheels = replace(
        wheels,
        coulomb_friction=wheels.coulomb_friction * (1.0 + x[6:9]),
        stiction_speed=wheels.stiction_speed * (10.0 + x[9]),
    )
    motor = reaction_wheels.limit_torque(wheels, command + 0.01 * x[:3], speed, 0.2)
    return 1e2 * motor, 1e3 * reaction_wheels.bearing_friction(wheels, speed)


@pytest.mark.parametrize("speed", [0.0, 300.0, 627.0, -640.0], ids=["at rest", "fast", "near its limit", "beyond it"])
def test_derivatives_of_motor_torque_and_friction_are_right(params: Params, speed: float) -> None:
    check(wheel_drive, 10, params.plant, np.array([0.01, 0.04, 0.02]), np.array([0.0, 1.0, speed]))


def test_motor_torque_and_friction_have_finite_derivatives_at_the_limits_of_torque_and_speed(params: Params) -> None:
    check_finite(wheel_drive, 10, params.plant, np.array([0.025, -0.025, 0.0]), np.array([0.0, 628.0, -628.0]))


@functools.partial(jax.jit, static_argnums=(4, 5))
def valve(
    x: jax.Array, plant_params: PlantParams, ignition: jax.Array, on_time: jax.Array, method: Method, ramps: bool
) -> Any:
    """Thrust over a step, with a minimum on-time of zero."""
    known = plant_params.thruster
    thruster = replace(
        known,
        minimum_on_time=jnp.zeros(()),
        rise_time=known.rise_time * (1.0 + 0.1 * x[0]),
        fall_time=known.fall_time * (1.0 + 0.1 * x[1]),
        misalignment=0.1 * x[2:5],
        force=known.force * (1.0 + x[5]),
    )
    error = BurnError(magnitude=x[6], direction=0.1 * x[7:10])
    begin = ignition + 0.02 * x[10]
    burn = ValveCommand(ignition=begin, cutoff=begin + on_time + 0.02 * x[11], burn_error=error)
    found = thrust_over_step(thruster, burn, method, ramps, 0.2)
    shift = center_of_mass_shift(thruster, 1.0 + x[12], 30.0 - x[12])
    return found.node_factors, 1e2 * found.force_B, 1e4 * found.mass_flow, 1e2 * shift


VALVES: tuple[tuple[Method, bool], ...] = (("rk4", False), ("rk4", True), ("rk8", True))


@pytest.mark.parametrize(("method", "ramps"), VALVES, ids=["on or off", "ramps", "ramps for the checks"])
@pytest.mark.parametrize(
    ("ignition", "on_time"),
    [(0.03, 0.02), (0.03, 0.11), (-1.0, 1.1), (0.17, 1.0), (-0.3, 0.27)],
    ids=["cut while it rises", "inside", "ends inside", "starts inside", "falls inside"],
)
def test_derivatives_of_a_thruster_over_a_step_are_right(
    params: Params, ignition: float, on_time: float, method: Method, ramps: bool
) -> None:
    check(lambda *arguments: valve(*arguments, method, ramps), 13, params.plant, np.float64(ignition),
          np.float64(on_time))  # fmt: skip


@pytest.mark.parametrize("ramps", [False, True], ids=["on or off", "ramps"])
@pytest.mark.parametrize(
    ("ignition", "on_time"),
    [(0.1, 0.0), (0.1, 0.05), (0.0, 0.2), (0.2, 0.5), (-0.08, 0.0)],
    ids=["no time", "just risen", "exactly the step", "from the end on", "just fallen"],
)
def test_a_thruster_has_finite_derivatives_at_the_corners_of_its_profile(
    params: Params, ignition: float, on_time: float, ramps: bool
) -> None:
    check_finite(lambda *arguments: valve(*arguments, "rk4", ramps), 13, params.plant, np.float64(ignition),
                 np.float64(on_time))  # fmt: skip


NOMINAL = Effects()
FULL = Effects(
    zonal_degree=6,
    sun_gravity=True,
    moon_gravity=True,
    drag=True,
    solar_pressure=True,
    wheel_friction=True,
    thruster_ramps=True,
    center_of_mass_shift=True,
    faults=True,
)
"""All effects but the quantisation of torque, whose derivative is a convention with its own test."""
SKY = SunMoonPositions(sun_N=jnp.asarray(SUN_N), moon_N=3.84e8 * jnp.asarray(W))


def plant_step(
    effects: Effects, x: jax.Array, plant_params: PlantParams, truth: Truth, ignition: jax.Array, cutoff: jax.Array
) -> Any:
    """Parts of the truth after a step, each scaled to the order of one."""
    moved = replace(
        truth,
        r_TN_N=truth.r_TN_N + 1e5 * x[15:18],
        r_ST_N=truth.r_ST_N + x[:3],
        omega_BN_B=truth.omega_BN_B + 0.1 * x[3:6],
        mass=truth.mass + 10.0 * x[6],
        wheel_speed=truth.wheel_speed + x[18:],
    )
    error = BurnError(magnitude=0.1 * x[8], direction=0.1 * x[9:12])
    command = jnp.array([0.01, 0.1, 0.01]) + 0.01 * x[12:15]
    burn = ValveCommand(ignition=ignition, cutoff=cutoff + 0.1 * x[7], burn_error=error)
    thrust = thrust_over_step(plant_params.thruster, burn, effects.integrator, effects.thruster_ramps, 0.2)
    failed = replace(
        equipment_faults.healthy(),
        thrust_fraction=jnp.asarray(0.6),
        wheel_friction=jnp.array([0.1, 0.0, 0.0]),
        wheel_stuck=jnp.array([False, True, False]),
    )
    after = plant.step(effects, plant_params, moved, command, (thrust,), SKY, failed, 0.2)
    gained = (after.v_ST_N - truth.v_ST_N) * 1e3
    turned = (after.omega_BN_B, after.q_BN, 1e-2 * (after.wheel_speed - truth.wheel_speed))
    target = (1e-1 * (after.v_TN_N - truth.v_TN_N), 1e3 * (after.omega_TN_T - truth.omega_TN_T))
    return after.r_ST_N - truth.r_ST_N, gained, *turned, *target, 1e4 * (after.mass - truth.mass)


nominal_step, full_step, rk8_step = (
    jax.jit(functools.partial(plant_step, effects)) for effects in (NOMINAL, FULL, static(FULL, integrator="rk8"))
)


@pytest.fixture(scope="module")
def truth(params: Params) -> Truth:
    start = plant_state.initial_truth(
        params.plant,
        params.orbit,
        jnp.array([2.0, -30.0, 1.0]),
        jnp.array([0.01, 0.0, 0.0]),
        jnp.asarray(axis_angle_quaternion(V, 0.7)),
    )
    return replace(start, wheel_speed=jnp.array([10.0, -20.0, 628.5]))  # the third beyond its limit


@pytest.fixture(scope="module")
def ready(params: Params) -> PlantParams:
    """Plant with a minimum on-time of zero, and sunlight and air dense enough to matter within a step."""
    return replace(
        params.plant,
        thruster=replace(params.plant.thruster, minimum_on_time=jnp.zeros(())),
        sunlight=replace(params.plant.sunlight, flux=jnp.float64(1e8)),
        atmosphere=replace(params.plant.atmosphere, density=jnp.float64(1e-8)),
    )


STEPS = pytest.mark.parametrize("kernel", [nominal_step, full_step], ids=["nominal", "every effect"])


@STEPS
@pytest.mark.parametrize(("ignition", "cutoff"), [(-1.0, 0.13), (0.4, 0.9)], ids=["burning", "coasting"])
def test_derivatives_of_a_step_of_the_plant_are_right_with_a_saturated_wheel(
    ready: PlantParams, truth: Truth, kernel: Kernel, ignition: float, cutoff: float
) -> None:
    check(kernel, 21, ready, truth, np.float64(ignition), np.float64(cutoff))


@pytest.mark.slow
def test_derivatives_of_a_step_of_the_eighth_order_integrator_are_right(ready: PlantParams, truth: Truth) -> None:
    check(rk8_step, 21, ready, truth, np.float64(-1.0), np.float64(0.13))


@STEPS
def test_derivatives_of_a_step_of_the_plant_are_right_without_rotation(
    ready: PlantParams, truth: Truth, kernel: Kernel
) -> None:
    resting = replace(truth, omega_BN_B=jnp.zeros(3), omega_TN_T=jnp.zeros(3), wheel_speed=jnp.zeros(3))
    check(kernel, 21, ready, resting, np.float64(-1.0), np.float64(0.13))


def test_derivatives_of_a_step_of_the_plant_are_right_in_the_penumbra(ready: PlantParams, truth: Truth) -> None:
    inner, outer = touching(7.0e6, True, 6.957e8), touching(7.0e6, False, 6.957e8)
    there = replace(truth, r_TN_N=jnp.asarray(behind(7.0e6, 0.6 * inner + 0.4 * outer)))
    check(full_step, 21, ready, there, np.float64(-1.0), np.float64(0.13))


@STEPS
def test_a_step_of_the_plant_has_finite_derivatives_with_a_burn_of_zero_duration(
    params: Params, ready: PlantParams, truth: Truth, kernel: Kernel
) -> None:
    for plant_params in (params.plant, ready):
        check_finite(kernel, 21, plant_params, truth, np.float64(0.1), np.float64(0.1))


@pytest.mark.parametrize("inner", [True, False], ids=["inner border", "outer border"])
def test_a_step_of_the_plant_has_finite_derivatives_at_the_border_of_the_shadow_with_wheels_at_their_limits(
    ready: PlantParams, truth: Truth, inner: bool
) -> None:
    edge = replace(
        truth,
        r_TN_N=jnp.asarray(behind(7.0e6, touching(7.0e6, inner, 6.957e8))),
        r_ST_N=jnp.zeros(3),
        wheel_speed=jnp.array([628.0, 0.0, -628.0]),
    )
    check_finite(full_step, 21, ready, edge, np.float64(0.1), np.float64(0.1))


def test_a_step_of_the_plant_has_finite_derivatives_with_a_thruster_without_force(
    ready: PlantParams, truth: Truth
) -> None:
    dead = replace(ready, thruster=replace(ready.thruster, force_scale=jnp.zeros(())))
    check_finite(nominal_step, 21, dead, truth, np.float64(-1.0), np.float64(0.13))
