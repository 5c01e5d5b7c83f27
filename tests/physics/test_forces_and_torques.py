"""Every effect of the plant by itself: its influence on the motion, and that it is absent when off."""

import functools
from collections.abc import Callable
from dataclasses import replace as static
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy_reference import IDENTITY, axis_angle_quaternion, rotation_matrix, unit
from scipy.integrate import solve_ivp

from rpojax.core.orbits import eclipse
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.physics import equipment_faults, forces_and_torques, plant, plant_state
from rpojax.physics.equipment_faults import Health
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import PlantParams, Truth
from rpojax.physics.thruster import BurnError, StepThrust, ValveCommand, thrust_over_step
from rpojax.scenario.params import Params

STEP = 0.2
NOTHING = Effects(zonal_degree=0, gravity_gradient=False)
SKY = SunMoonPositions(sun_N=jnp.array([1.0e11, 1.1e11, 2.0e10]), moon_N=jnp.array([-3.0e8, 2.0e8, 1.0e8]))
HEALTHY = equipment_faults.healthy()
FAR = jnp.array([1e14, 0.0, 0.0])
"""Position so far from the Earth that its gravity is negligible."""

ALONE: dict[str, Effects] = {
    "zonal_degree": static(NOTHING, zonal_degree=6),
    **{
        name: static(NOTHING, **{name: True})
        for name in (
            "sun_gravity",
            "moon_gravity",
            "drag",
            "solar_pressure",
            "gravity_gradient",
            "wheel_friction",
            "wheel_torque_steps",
            "center_of_mass_shift",
            "faults",
        )
    },
}
"""Switches with a single effect on."""

_step = jax.jit(plant.step, static_argnums=(0, 7))
initial_truth = jax.jit(plant_state.initial_truth)


@functools.partial(jax.jit, static_argnums=0)
def simulate(
    effects: Effects, params: PlantParams, truth: Truth, commands: jax.Array, health: Health = HEALTHY
) -> Truth:
    """Truth after each step with wheel torque commands (n, 3) and no thruster."""

    def body(truth: Truth, command: jax.Array) -> tuple[Truth, Truth]:
        after = plant.step(effects, params, truth, command, (), SKY, health, STEP)
        return after, after

    return jax.lax.scan(body, truth, commands)[1]


def step_thrust(params: PlantParams, ignition: float = -1.0, cutoff: float = 1.0) -> StepThrust:
    none = BurnError(magnitude=jnp.zeros(()), direction=jnp.zeros(3))
    burn = ValveCommand(ignition=jnp.float64(ignition), cutoff=jnp.float64(cutoff), burn_error=none)
    return thrust_over_step(params.thruster, burn, "rk4", False, STEP)


def advance(
    effects: Effects,
    params: PlantParams,
    truth: Truth,
    command: Any = (0.0, 0.0, 0.0),
    thrusts: tuple[StepThrust, ...] = (),
    health: Health = HEALTHY,
    sky: SunMoonPositions = SKY,
) -> Truth:
    """Truth one step later."""
    return _step(effects, params, truth, np.array(command), thrusts, sky, health, STEP)


@pytest.fixture(scope="module")
def in_orbit(params: Params) -> Truth:
    """The start of the nominal scenario, drifting, with both bodies rotating and the wheels spinning."""
    rho, rho_dot = jnp.array([2.0, -50.0, 3.0]), jnp.array([0.01, -0.002, 0.02])
    truth = initial_truth(
        params.plant, params.orbit, rho, rho_dot, axis_angle_quaternion(np.array([1.0, 2.0, 3.0]), 0.7)
    )
    return replace(
        truth,
        omega_BN_B=jnp.array([0.01, -0.012, 0.008]),
        wheel_speed=jnp.array([15.0, -10.0, 20.0]),
        omega_TN_T=jnp.array([0.012, 0.009, -0.011]),
    )


@pytest.fixture(scope="module")
def at_rest(in_orbit: Truth) -> Truth:
    """Far away, the servicer at rest with its axes along those of N."""
    return replace(
        in_orbit,
        r_TN_N=FAR,
        v_TN_N=jnp.zeros(3),
        v_ST_N=jnp.zeros(3),
        q_BN=jnp.asarray(IDENTITY),
        omega_BN_B=jnp.zeros(3),
        wheel_speed=jnp.zeros(3),
    )


def health(**changed: Any) -> Health:
    return replace(HEALTHY, **{name: jnp.asarray(value) for name, value in changed.items()})


# Off means off


def assert_equal(found: Truth, expected: Truth) -> None:
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(a, b)


def unknown(tree: Any) -> Any:
    """The same pytree with every number replaced by NaN."""
    return jax.tree.map(lambda leaf: jnp.full_like(leaf, jnp.nan), jax.tree.map(jnp.asarray, tree))


def test_parameters_of_effects_that_are_off_are_not_used(params: Params, in_orbit: Truth) -> None:
    known = params.plant
    wheels = unknown(known.wheels)
    blind = replace(
        known,
        servicer_surface=unknown(known.servicer_surface),
        target_surface=unknown(known.target_surface),
        target=replace(known.target, mass=jnp.float64(jnp.nan)),
        thruster=unknown(known.thruster),
        wheels=replace(
            known.wheels,
            viscous_friction=wheels.viscous_friction,
            coulomb_friction=wheels.coulomb_friction,
            stiction_speed=wheels.stiction_speed,
            torque_step=wheels.torque_step,
        ),
        gravity=replace(known.gravity, zonals=unknown(known.gravity.zonals), radius=jnp.float64(jnp.nan)),
        atmosphere=unknown(known.atmosphere),
        sunlight=unknown(known.sunlight),
        faults=unknown(known.faults),
    )
    sick = replace(HEALTHY, wheel_friction=jnp.full(3, jnp.nan), wheel_stuck=jnp.ones(3, dtype=bool))
    command, thrusts = (0.01, 0.0, -0.02), (step_thrust(known),)
    expected = advance(NOTHING, known, in_orbit, command, thrusts)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(expected))
    assert_equal(advance(NOTHING, blind, in_orbit, command, thrusts, sick, unknown(SKY)), expected)


NEUTRAL: dict[str, Callable[[PlantParams], PlantParams]] = {
    "zonal_degree": lambda p: replace(p, gravity=replace(p.gravity, zonals=jnp.zeros(5))),
    "drag": lambda p: replace(p, atmosphere=replace(p.atmosphere, density=jnp.zeros(()))),
    "solar_pressure": lambda p: replace(p, sunlight=replace(p.sunlight, flux=jnp.zeros(()))),
    "wheel_friction": lambda p: replace(
        p, wheels=replace(p.wheels, viscous_friction=jnp.zeros(3), coulomb_friction=jnp.zeros(3))
    ),
    "center_of_mass_shift": lambda p: replace(p, thruster=replace(p.thruster, tank_position=jnp.zeros(3))),
    "faults": lambda p: p,
}
"""Parameters with which an effect has no influence."""


@pytest.mark.parametrize("name", NEUTRAL)
def test_an_effect_with_neutral_parameters_equals_one_that_is_off(params: Params, in_orbit: Truth, name: str) -> None:
    neutral, used = NEUTRAL[name](params.plant), replace(in_orbit, mass=in_orbit.mass - 1.0)
    command, thrusts = (0.01, 0.0, -0.02), (step_thrust(params.plant),)
    off, on = (advance(effects, neutral, used, command, thrusts) for effects in (NOTHING, ALONE[name]))
    for a, b in zip(jax.tree.leaves(on), jax.tree.leaves(off), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14, atol=1e-16)


def operations(effects: Effects, params: PlantParams, truth: Truth) -> list[str]:
    """Operations of a step before any optimisation, by their names."""
    arguments = (params, truth, jnp.zeros(3), (step_thrust(params),), SKY, HEALTHY)
    lowered = _step.lower(effects, *arguments, STEP).as_text()
    return [word for line in lowered.splitlines() for word in line.split() if word.startswith("stablehlo.")]


@pytest.fixture(scope="module")
def bare(params: Params, in_orbit: Truth) -> list[str]:
    """Operations of the plant with every effect off."""
    return operations(NOTHING, params.plant, in_orbit)


def test_the_plant_without_effects_compiles_none_of_their_operations(bare: list[str]) -> None:
    for name in ("exponential", "tanh", "atan2", "round_nearest_even", "round_nearest_afz"):
        assert not [word for word in bare if word.startswith(f"stablehlo.{name}")]


@pytest.mark.parametrize("name", ALONE)
def test_an_effect_is_compiled_only_when_it_is_on(params: Params, in_orbit: Truth, bare: list[str], name: str) -> None:
    found = operations(ALONE[name], params.plant, in_orbit)
    assert len(found) > len(bare)
    trace = {"drag": "exponential", "wheel_friction": "tanh", "faults": "tanh", "solar_pressure": "atan2"}
    if name in trace:
        assert f"stablehlo.{trace[name]}" in found


def test_ramps_are_compiled_only_when_they_are_on(params: Params) -> None:
    none = BurnError(magnitude=jnp.zeros(()), direction=jnp.zeros(3))
    burn = ValveCommand(ignition=jnp.zeros(()), cutoff=jnp.ones(()), burn_error=none)
    lower = jax.jit(thrust_over_step, static_argnums=(2, 3, 4)).lower
    off, on = (lower(params.plant.thruster, burn, "rk4", ramps, STEP).as_text() for ramps in (False, True))
    assert on.count("stablehlo.") > off.count("stablehlo.")


# Air and light


def test_relative_motion_with_drag_agrees_with_the_difference_of_two_orbits(params: Params, in_orbit: Truth) -> None:
    """Ten minutes in air of a thousandfold density, where the target with its larger area per mass falls behind."""
    dense = replace(params.plant, atmosphere=replace(params.plant.atmosphere, density=jnp.float64(5e-10)))
    truth = jax.tree.map(lambda leaf: leaf[-1], simulate(ALONE["drag"], dense, in_orbit, np.zeros((3000, 3))))
    vacuum = jax.tree.map(lambda leaf: leaf[-1], simulate(NOTHING, dense, in_orbit, np.zeros((3000, 3))))

    def absolute(r: np.ndarray, v: np.ndarray, area: float, mass: float) -> np.ndarray:
        def derivative(_: float, y: np.ndarray) -> np.ndarray:
            distance = np.linalg.norm(y[:3])
            density = 5e-10 * np.exp(-(distance - 6878137.0) / 63e3)
            flow = y[3:] - np.cross([0.0, 0.0, 7.292115e-5], y[:3])
            brake = -0.5 * density * 2.2 * area / mass * np.linalg.norm(flow) * flow
            return np.concatenate([y[3:], -3.986004418e14 * y[:3] / distance**3 + brake])

        return solve_ivp(derivative, (0.0, 600.0), np.concatenate([r, v]), "DOP853", rtol=1e-13, atol=1e-7).y[:, -1]

    start = jax.tree.map(np.asarray, in_orbit)
    target = absolute(start.r_TN_N, start.v_TN_N, 0.6, 45.0)
    servicer = absolute(start.r_TN_N + start.r_ST_N, start.v_TN_N + start.v_ST_N, 0.25, 30.0)
    # The reference loses nine of its sixteen digits in the difference; its integration error is common to both.
    np.testing.assert_allclose(truth.r_ST_N, (servicer - target)[:3], atol=1e-5)
    np.testing.assert_allclose(truth.v_ST_N, (servicer - target)[3:], atol=1e-8)
    assert np.linalg.norm(truth.r_ST_N - vacuum.r_ST_N) > 10.0  # differential drag of 160 um/s^2


def test_solar_radiation_pressure_separates_vehicles_of_different_area_per_mass(
    params: Params, in_orbit: Truth
) -> None:
    lit = replace(in_orbit, r_TN_N=7.0e6 * SKY.sun_N / jnp.sqrt(jnp.sum(SKY.sun_N**2)))
    on, off = (advance(effects, params.plant, lit) for effects in (ALONE["solar_pressure"], NOTHING))
    distance = np.linalg.norm(SKY.sun_N - lit.r_TN_N)
    pressure = 1361.0 / 299792458.0 * (1.495978707e11 / distance) ** 2
    away = -np.asarray(SKY.sun_N) / np.linalg.norm(SKY.sun_N)
    on_servicer, on_target = pressure * 1.3 * 0.25 / 30.0, pressure * 1.4 * 0.6 / 45.0
    # Velocities of 7 km/s are rounded to 1e-12 m/s, of 2e-8 m/s by the step; the relative one keeps all digits.
    np.testing.assert_allclose(on.v_TN_N - off.v_TN_N, on_target * away * STEP, atol=2e-12)
    np.testing.assert_allclose(on.v_ST_N - off.v_ST_N, (on_servicer - on_target) * away * STEP, atol=1e-16)


def test_the_sunlit_fractions_of_a_step_are_those_of_both_vehicles_in_its_middle(
    params: Params, in_orbit: Truth
) -> None:
    # At the border of the shadow behind the Earth, which both cross towards the light; the penumbra takes 8 s.
    distance, dt = 7.0e6, 2.0
    angle = np.arcsin(6378137.0 / distance)
    sun = unit(np.array([1.0, 0.2, -0.1]))
    across = unit(np.cross(sun, [0.0, 0.0, 1.0]))
    outward = unit(np.cos(angle) * across + np.sin(angle) * sun)
    truth = replace(
        in_orbit,
        r_TN_N=jnp.asarray(distance * (-np.cos(angle) * sun + np.sin(angle) * across)),
        v_TN_N=jnp.asarray(7500.0 * outward),
        r_ST_N=jnp.asarray(8000.0 * outward),
        v_ST_N=jnp.asarray(3000.0 * outward),
    )
    sky = SunMoonPositions(sun_N=jnp.asarray(1.496e11 * sun), moon_N=SKY.moon_N)
    fractions = functools.partial(forces_and_torques.sunlit_fractions, ALONE["solar_pressure"], params.plant)
    target, servicer = fractions(truth, sky, dt)
    middle_of_target = np.asarray(truth.r_TN_N) + 0.5 * dt * np.asarray(truth.v_TN_N)
    middle_of_servicer = middle_of_target + np.asarray(truth.r_ST_N) + 0.5 * dt * np.asarray(truth.v_ST_N)
    sunlight = params.plant.sunlight
    expected = [
        eclipse.illumination(jnp.asarray(r), sky.sun_N, sunlight.shadow_radius, sunlight.sun_radius)
        for r in (middle_of_target, middle_of_servicer)
    ]
    assert 0.2 < expected[0] < expected[1] - 0.1 < 0.8
    np.testing.assert_allclose([target, servicer], expected, atol=1e-8)  # to half of the digits, see there
    off = forces_and_torques.sunlit_fractions(ALONE["drag"], params.plant, truth, sky, dt)
    np.testing.assert_array_equal(off, [0.0, 0.0])


@pytest.mark.parametrize("name", ["drag", "solar_pressure"])
def test_surface_forces_off_the_centre_of_mass_give_torques_on_both_vehicles(
    params: Params, in_orbit: Truth, name: str
) -> None:
    lit = replace(in_orbit, r_TN_N=6878137.0 * SKY.sun_N / jnp.sqrt(jnp.sum(SKY.sun_N**2)))
    slow = replace(lit, omega_BN_B=jnp.zeros(3), omega_TN_T=jnp.zeros(3), wheel_speed=jnp.zeros(3))
    strong = replace(
        params.plant,
        atmosphere=replace(params.plant.atmosphere, density=jnp.float64(5e-10)),
        sunlight=replace(params.plant.sunlight, flux=jnp.float64(1.361e6)),
    )
    on, off = (advance(effects, strong, slow) for effects in (ALONE[name], NOTHING))
    wheels, target = strong.wheels, strong.target
    force_on_target = (on.v_TN_N - off.v_TN_N) * 45.0 / STEP
    force_on_servicer = ((on.v_ST_N - off.v_ST_N) + (on.v_TN_N - off.v_TN_N)) * 30.0 / STEP
    gained = np.asarray(strong.servicer.inertia) @ on.omega_BN_B + wheels.inertia * on.wheel_speed
    expected = np.cross([0.01, 0.005, -0.005], rotation_matrix(np.asarray(slow.q_BN)) @ force_on_servicer) * STEP
    np.testing.assert_allclose(gained, expected, rtol=1e-5, atol=1e-9 * np.max(np.abs(expected)))
    expected = np.cross([0.02, 0.0, 0.01], rotation_matrix(np.asarray(slow.q_TN)) @ force_on_target) * STEP
    found = np.asarray(target.inertia) @ on.omega_TN_T
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.max(np.abs(expected)))


# Third bodies


@pytest.mark.parametrize(("name", "mu"), [("sun_gravity", 1.32712440018e20), ("moon_gravity", 4.9028e12)])
def test_third_body_accelerations_agree_with_tides_in_extended_precision(
    params: Params, in_orbit: Truth, name: str, mu: float
) -> None:
    apart = replace(in_orbit, r_ST_N=jnp.array([3e4, -2e4, 1e4]))
    on, off = (advance(effects, params.plant, apart) for effects in (ALONE[name], NOTHING))
    body = np.asarray(SKY.sun_N if name == "sun_gravity" else SKY.moon_N, dtype=np.longdouble)

    def tide(r: np.ndarray) -> np.ndarray:
        away = body - r
        return mu * (away / np.sqrt(away @ away) ** 3 - body / np.sqrt(body @ body) ** 3)

    r = np.asarray(apart.r_TN_N + 0.5 * STEP * apart.v_TN_N, dtype=np.longdouble)  # in the middle of the step
    d = np.asarray(apart.r_ST_N + 0.5 * STEP * apart.v_ST_N, dtype=np.longdouble)
    expected = (tide(r + d) - tide(r)).astype(float) * STEP
    # Velocities of 7 km/s have roundings of 1e-12.
    np.testing.assert_allclose(on.v_TN_N - off.v_TN_N, tide(r).astype(float) * STEP, atol=2e-12)
    np.testing.assert_allclose(on.v_ST_N - off.v_ST_N, expected, atol=1e-6 * np.max(np.abs(expected)))


# Wheels


def total_momentum(params: PlantParams, truth: Truth) -> np.ndarray:
    """Angular momentum of servicer and wheels [N m s] in N."""
    wheels = params.wheels
    wheel = np.asarray(wheels.axes).T @ (np.asarray(wheels.inertia) * np.asarray(truth.wheel_speed))
    body = np.asarray(params.servicer.inertia) @ np.asarray(truth.omega_BN_B)
    return rotation_matrix(np.asarray(truth.q_BN)).T @ (body + wheel)


def last(history: Truth) -> Truth:
    return jax.tree.map(lambda leaf: np.asarray(leaf[-1]), history)


@pytest.mark.parametrize("rubbing", [0.0, 0.1, 0.8], ids=["stuck", "stuck, friction", "stuck, high friction"])
def test_body_and_wheels_keep_their_angular_momentum_with_friction_steps_and_a_stuck_wheel(
    params: Params, in_orbit: Truth, rubbing: float
) -> None:
    # The friction turns the body at some degrees per second, where RK4's own error in ten minutes is 3e-10.
    effects = static(NOTHING, integrator="rk8", wheel_friction=True, wheel_torque_steps=True, faults=True)
    truth = replace(in_orbit, r_TN_N=FAR, v_TN_N=jnp.zeros(3))
    bad = health(wheel_stuck=[False, True, False], wheel_friction=[rubbing, 0.0, 0.0])
    phase = 2.0 * np.pi * STEP * np.arange(3000)[:, None] / np.array([300.0, 400.0, 500.0])
    start = total_momentum(params.plant, truth)
    after = last(simulate(effects, params.plant, truth, 1e-3 * np.sin(phase), bad))
    assert np.linalg.norm(total_momentum(params.plant, after) - start) < 1e-10 * np.linalg.norm(start)
    assert abs(after.wheel_speed[1]) < 1.0
    assert abs(after.wheel_speed[2]) > 1.0


def test_a_wheel_with_viscous_friction_alone_runs_down_exponentially(params: Params, at_rest: Truth) -> None:
    wheels = replace(params.plant.wheels, viscous_friction=jnp.full(3, 1e-5), coulomb_friction=jnp.zeros(3))
    free = replace(params.plant, wheels=wheels, servicer=replace(params.plant.servicer, inertia=1e6 * jnp.eye(3)))
    truth = replace(at_rest, wheel_speed=jnp.array([100.0, -200.0, 0.0]))
    after = last(simulate(ALONE["wheel_friction"], free, truth, np.zeros((500, 3))))
    # 8e-4 kg m^2 over 1e-5 N m s: a time constant of 80 s; the body is too heavy to rotate.
    np.testing.assert_allclose(after.wheel_speed, np.exp(-100.0 / 80.0) * np.array([100.0, -200.0, 0.0]), rtol=1e-8,
                               atol=1e-12)  # fmt: skip


def test_a_stuck_wheel_stops_within_seconds_and_ignores_commands(params: Params, at_rest: Truth) -> None:
    heavy = replace(params.plant, servicer=replace(params.plant.servicer, inertia=1e6 * jnp.eye(3)))
    truth = replace(at_rest, wheel_speed=jnp.array([100.0, 100.0, 100.0]))
    bad = health(wheel_stuck=[False, True, False])
    after = last(simulate(ALONE["faults"], heavy, truth, np.tile([1e-4, 1e-4, 0.0], (100, 1)), bad))
    # A time constant of 2 s, for 20 s; its neighbour spins up by 1e-4 / 8e-4 rad/s^2.
    np.testing.assert_allclose(after.wheel_speed, [100.0 + 2.5, 100.0 * np.exp(-10.0), 100.0], rtol=1e-5)


@pytest.mark.parametrize("severity", [0.1, 0.4, 0.8, 1.0])
def test_a_wheel_with_fault_friction_decelerates_linearly_and_then_rests(
    params: Params, at_rest: Truth, severity: float
) -> None:
    """A wheel without command must not chatter about zero at any friction."""
    heavy = replace(params.plant, servicer=replace(params.plant.servicer, inertia=1e6 * jnp.eye(3)))
    truth = replace(at_rest, wheel_speed=jnp.array([200.3, 0.0, 0.0]))
    history = simulate(ALONE["faults"], heavy, truth, np.zeros((1000, 3)), health(wheel_friction=[severity, 0.0, 0.0]))
    speed = np.asarray(history.wheel_speed[:, 0])
    brake = severity * 0.025 / 8e-4
    fast = speed > 60.0
    times = STEP * (1.0 + np.arange(1000.0))
    np.testing.assert_allclose(speed[fast], 200.3 - brake * times[fast], rtol=1e-6)
    assert np.all(np.abs(speed[~fast]) < 60.0)
    assert np.max(np.abs(speed[-100:])) < 1e-3
    assert np.all(np.diff(np.abs(speed)) <= 1e-12)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_saturated_wheel_stays_within_a_thousandth_of_its_speed_limit(
    params: Params, at_rest: Truth, sense: float
) -> None:
    everything = static(NOTHING, wheel_friction=True, wheel_torque_steps=True, faults=True)
    for effects in (NOTHING, everything):
        truth = replace(at_rest, wheel_speed=jnp.array([sense * 600.0, 0.0, 0.0]))
        history = simulate(effects, params.plant, truth, np.tile([sense * 0.025, 0.0, 0.0], (200, 1)))
        speed = np.asarray(history.wheel_speed[:, 0])
        assert np.max(np.abs(speed)) < 628.0 * 1.001
        assert np.max(np.abs(speed)) > 620.0
    at_limit = replace(at_rest, wheel_speed=jnp.array([sense * 628.0, 0.0, 0.0]))
    pushed = advance(NOTHING, params.plant, at_limit, (sense * 0.025, 0.0, 0.0))
    left_alone = advance(NOTHING, params.plant, at_limit)
    assert_equal(pushed, left_alone)
    slowed = advance(NOTHING, params.plant, at_limit, (-sense * 0.025, 0.0, 0.0))
    assert abs(float(slowed.wheel_speed[0])) < 623.0


def test_the_wheel_drive_gives_whole_steps_of_torque(params: Params, at_rest: Truth) -> None:
    heavy = replace(params.plant, servicer=replace(params.plant.servicer, inertia=1e6 * jnp.eye(3)))
    command = 2e-5 * np.array([7.4, -7.6, 0.4])
    after = advance(ALONE["wheel_torque_steps"], heavy, at_rest, command)
    np.testing.assert_allclose(
        after.wheel_speed, 2e-5 * np.array([7.0, -8.0, 0.0]) * STEP / 8e-4, rtol=1e-8, atol=1e-18
    )


# Thrusters


def test_forces_torques_and_flows_of_two_thrusters_add_up(params: Params, at_rest: Truth) -> None:
    one = step_thrust(params.plant)
    other = replace(one, force_B=jnp.array([0.0, 0.02, 0.0]), position_B=jnp.array([0.0, 0.0, 0.3]))
    after = advance(NOTHING, params.plant, at_rest, thrusts=(one, other))
    np.testing.assert_allclose(
        after.v_ST_N, np.array([0.03, 0.02, 0.0]) / 30.0 * STEP, atol=1e-8
    )  # its rotation is negligible
    gained = total_momentum(params.plant, after)
    np.testing.assert_allclose(gained, [-0.3 * 0.02 * STEP, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(after.delta_v, 0.05 / 30.0 * STEP, rtol=1e-5)
    np.testing.assert_allclose(at_rest.mass - after.mass, 2.0 * 0.03 / (70.0 * 9.80665) * STEP, rtol=1e-9)


@pytest.mark.parametrize("fraction", [0.0, 0.3, 1.0])
def test_a_weak_thruster_scales_force_and_mass_flow(params: Params, at_rest: Truth, fraction: float) -> None:
    after = advance(
        ALONE["faults"],
        params.plant,
        at_rest,
        thrusts=(step_thrust(params.plant),),
        health=health(thrust_fraction=fraction),
    )
    np.testing.assert_allclose(after.v_ST_N, [fraction * 0.03 / 30.0 * STEP, 0.0, 0.0], rtol=1e-5, atol=1e-18)
    np.testing.assert_allclose(at_rest.mass - after.mass, fraction * 0.03 / (70.0 * 9.80665) * STEP, rtol=1e-8)


def test_the_lever_arm_of_thrust_is_about_the_moved_centre_of_mass(params: Params, at_rest: Truth) -> None:
    used = replace(at_rest, mass=at_rest.mass - 2.0)
    across = replace(step_thrust(params.plant), force_B=jnp.array([0.0, 0.03, 0.0]))
    fixed, moved = (
        total_momentum(params.plant, advance(effects, params.plant, used, thrusts=(across,)))[2]
        for effects in (NOTHING, ALONE["center_of_mass_shift"])
    )
    np.testing.assert_allclose(fixed, -0.25 * 0.03 * STEP, rtol=1e-4)
    np.testing.assert_allclose(moved, -(0.25 + 0.2 / 28.0) * 0.03 * STEP, rtol=1e-4)


# The integrator of the checks


def test_both_integrators_agree_with_all_effects(params: Params, in_orbit: Truth) -> None:
    everything = Effects(
        zonal_degree=6,
        sun_gravity=True,
        moon_gravity=True,
        drag=True,
        solar_pressure=True,
        wheel_friction=True,
        center_of_mass_shift=True,
    )
    commands = np.tile([1e-4, -2e-4, 5e-5], (3000, 1))
    rk4, rk8 = (
        last(simulate(static(everything, integrator=method), params.plant, in_orbit, commands))
        for method in ("rk4", "rk8")
    )
    # RK4 in steps of 0.2 s is good to 1e-14 of an orbit's radius; the attitude turns by milliradians per step.
    np.testing.assert_allclose(rk4.r_TN_N, rk8.r_TN_N, atol=1e-6)
    np.testing.assert_allclose(rk4.r_ST_N, rk8.r_ST_N, atol=1e-9)
    np.testing.assert_allclose(rk4.q_BN, rk8.q_BN, atol=1e-9)
    np.testing.assert_allclose(rk4.wheel_speed, rk8.wheel_speed, atol=1e-4)
