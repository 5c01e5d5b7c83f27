"""Plant step against conservation laws, exact burns and scipy's integrators."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy_reference import IDENTITY, gravity, rotation_matrix
from scipy.integrate import solve_ivp

from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.physics import equipment_faults, plant, plant_state, plume_impingement, rcs_thrusters
from rpojax.physics.equipment_faults import Health
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import PlantParams, Truth
from rpojax.physics.plume_impingement import Impingement
from rpojax.physics.rcs_thrusters import RcsState
from rpojax.physics.thruster import BurnError, StepThrust, ValveCommand, thrust_over_step
from rpojax.scenario.params import Params
from rpojax.scenario.trained.coverage_surface import hull_triangles
from rpojax.simulation import single_precision

STEP = 0.2
HOUR = round(3600.0 / STEP)
BURN_STEPS = 20
G0 = 9.80665
EFFECTS = Effects()
SKY = SunMoonPositions(sun_N=jnp.array([1.0e11, 1.1e11, 2.0e10]), moon_N=jnp.array([-3.0e8, 2.0e8, 1.0e8]))
HEALTHY = equipment_faults.healthy()
step = jax.jit(plant.step, static_argnums=(0, 7))
initial_truth = jax.jit(plant_state.initial_truth)


@functools.partial(jax.jit, static_argnums=0)
def simulate(
    effects: Effects,
    params: PlantParams,
    truth: Truth,
    commands: jax.Array,
    health: Health = HEALTHY,
    sky: SunMoonPositions = SKY,
) -> Truth:
    """Truth after each step with wheel torque commands (n, 3) and no thruster."""

    def body(truth: Truth, command: jax.Array) -> tuple[Truth, Truth]:
        after = plant.step(effects, params, truth, command, (), sky, health, STEP)
        return after, after

    return jax.lax.scan(body, truth, commands)[1]


@functools.partial(jax.jit, static_argnums=0)
def simulate_burn(effects: Effects, params: PlantParams, truth: Truth, ignition: jax.Array, cutoff: jax.Array) -> Truth:
    """Truth after `BURN_STEPS` steps with the thruster open from `ignition` to `cutoff` [s]."""

    def body(truth: Truth, begin: jax.Array) -> tuple[Truth, None]:
        pushes = (step_thrust(params, ignition - begin, cutoff - begin, effects),)
        return plant.step(effects, params, truth, jnp.zeros(3), pushes, SKY, HEALTHY, STEP), None

    return jax.lax.scan(body, truth, STEP * jnp.arange(BURN_STEPS, dtype=jnp.float64))[0]


final_velocity_derivative = jax.jit(
    jax.jacfwd(lambda *arguments: simulate_burn(*arguments).v_ST_N, argnums=(3, 4)), static_argnums=0
)


def step_thrust(
    params: PlantParams, ignition: jax.Array | float, cutoff: jax.Array | float, effects: Effects = EFFECTS
) -> StepThrust:
    """The thruster open from `ignition` to `cutoff` [s] from the start of the step, without any error."""
    none = BurnError(magnitude=jnp.zeros(()), direction=jnp.zeros(3))
    burn = ValveCommand(ignition=jnp.float64(ignition), cutoff=jnp.float64(cutoff), burn_error=none)
    return thrust_over_step(params.thruster, burn, effects.integrator, effects.thruster_ramps, STEP)


def advance(
    effects: Effects,
    params: PlantParams,
    truth: Truth,
    command: np.ndarray | None = None,
    thrusts: tuple[StepThrust, ...] = (),
    health: Health = HEALTHY,
    sky: SunMoonPositions = SKY,
) -> Truth:
    """Truth one step later."""
    return step(effects, params, truth, np.zeros(3) if command is None else command, thrusts, sky, health, STEP)


@pytest.fixture(scope="module")
def in_orbit(params: Params) -> Truth:
    """The start of the nominal scenario, drifting, with both bodies rotating and the wheels spinning."""
    rho, rho_dot = jnp.array([2.0, -50.0, 3.0]), jnp.array([0.01, -0.002, 0.02])
    truth = initial_truth(params.plant, params.orbit, rho, rho_dot, jnp.asarray(IDENTITY))
    return replace(
        truth,
        omega_BN_B=jnp.array([0.01, -0.012, 0.008]),
        wheel_speed=jnp.array([15.0, -10.0, 20.0]),
        omega_TN_T=jnp.array([0.012, 0.009, -0.011]),
    )


@pytest.fixture(scope="module")
def far_away(in_orbit: Truth) -> Truth:
    """The same so far from the Earth that its gravity and gradient are negligible."""
    return replace(in_orbit, r_TN_N=jnp.array([1e14, 0.0, 0.0]), v_TN_N=jnp.zeros(3))


@pytest.fixture(scope="module")
def at_rest(params: Params, far_away: Truth) -> Truth:
    """Far away, the servicer's attitude at rest."""
    return replace(far_away, omega_BN_B=jnp.zeros(3), wheel_speed=jnp.zeros(3))


@pytest.fixture(scope="module")
def balanced(params: Params) -> PlantParams:
    """The plant with its thruster through the centre of mass, so that burns give no torque."""
    thruster = replace(params.plant.thruster, position=jnp.zeros(3), minimum_on_time=jnp.zeros(()))
    return replace(params.plant, thruster=thruster)


@pytest.fixture(scope="module")
def massless(balanced: PlantParams) -> PlantParams:
    """The same with a practically infinite specific impulse, so that the mass is constant."""
    return replace(balanced, thruster=replace(balanced.thruster, specific_impulse=jnp.float64(1e18)))


def inertial(q: np.ndarray, vector_B: np.ndarray) -> np.ndarray:
    return rotation_matrix(np.asarray(q)).T @ vector_B


def sampled(history: Truth) -> list[Truth]:
    """Every tenth minute of an hour's history, as numpy."""
    return [jax.tree.map(lambda leaf, k=k: np.asarray(leaf[k]), history) for k in range(2999, HOUR, 3000)]


def test_a_free_body_keeps_its_angular_momentum_and_energy_over_an_hour(params: Params, far_away: Truth) -> None:
    inertia = np.asarray(params.plant.target.inertia)

    def momentum_and_energy(truth: Truth) -> tuple[np.ndarray, float]:
        omega = np.asarray(truth.omega_TN_T)
        return inertial(truth.q_TN, inertia @ omega), float(omega @ inertia @ omega)

    start, start_energy = momentum_and_energy(far_away)
    for truth in sampled(simulate(EFFECTS, params.plant, far_away, np.zeros((HOUR, 3)))):
        momentum, energy = momentum_and_energy(truth)
        assert np.linalg.norm(momentum - start) < 1e-10 * np.linalg.norm(start)
        assert abs(energy - start_energy) < 1e-10 * start_energy


def test_body_and_wheels_together_keep_their_angular_momentum_over_an_hour_of_torques(
    params: Params, far_away: Truth
) -> None:
    inertia, wheels = np.asarray(params.plant.servicer.inertia), params.plant.wheels
    phase = 2.0 * np.pi * STEP * np.arange(HOUR)[:, None] / np.array([300.0, 400.0, 500.0])

    def momentum(truth: Truth) -> np.ndarray:
        wheel = np.asarray(wheels.axes).T @ (np.asarray(wheels.inertia) * np.asarray(truth.wheel_speed))
        return inertial(truth.q_BN, inertia @ np.asarray(truth.omega_BN_B) + wheel)

    start = momentum(far_away)
    history = sampled(simulate(EFFECTS, params.plant, far_away, 1e-4 * np.sin(phase)))
    for truth in history:
        assert np.linalg.norm(momentum(truth) - start) < 1e-10 * np.linalg.norm(start)
    moved = max(np.max(np.abs(truth.wheel_speed - far_away.wheel_speed)) for truth in history)
    assert moved > 5.0  # the torques have an effect


def test_the_relative_motion_agrees_with_the_difference_of_two_absolute_orbits(params: Params, in_orbit: Truth) -> None:
    truth = jax.tree.map(lambda leaf: leaf[-1], simulate(EFFECTS, params.plant, in_orbit, np.zeros((HOUR, 3))))

    def absolute(r: jax.Array, v: jax.Array) -> np.ndarray:
        solution = solve_ivp(
            lambda _, y: np.concatenate([y[3:], gravity(y[:3])]),
            (0.0, 3600.0),
            np.concatenate([r, v]),
            "DOP853",
            rtol=1e-13,
            atol=1e-7,
        )
        return solution.y[:, -1]

    target = absolute(in_orbit.r_TN_N, in_orbit.v_TN_N)
    servicer = absolute(in_orbit.r_TN_N + in_orbit.r_ST_N, in_orbit.v_TN_N + in_orbit.v_ST_N)
    # The reference loses nine of its sixteen digits in the difference; its integration error is common to both.
    np.testing.assert_allclose(truth.r_TN_N, target[:3], atol=1e-4)
    np.testing.assert_allclose(truth.r_ST_N, (servicer - target)[:3], atol=1e-5)
    np.testing.assert_allclose(truth.v_ST_N, (servicer - target)[3:], atol=1e-8)


@pytest.mark.parametrize(
    ("ignition", "cutoff"),
    [(-1.0, 1.0), (0.05, 1.0), (-1.0, 0.13), (0.03, 0.11), (0.1, 0.1), (0.0, 0.2), (0.199, 0.2)],
    ids=["whole step", "starts inside", "ends inside", "inside", "nothing", "exactly the step", "a millisecond"],
)
def test_a_step_with_a_valve_event_inside_agrees_with_the_exact_motion(
    balanced: PlantParams, at_rest: Truth, ignition: float, cutoff: float
) -> None:
    after = advance(EFFECTS, balanced, at_rest, thrusts=(step_thrust(balanced, ignition, cutoff),))
    force, flow = 0.03, 0.03 / (70.0 * G0)
    state = np.concatenate([[float(at_rest.mass)], at_rest.r_ST_N, at_rest.v_ST_N])
    events = np.clip([0.0, ignition, cutoff, STEP], 0.0, STEP)
    for begin, end, on in zip(events[:-1], events[1:], (0.0, 1.0, 0.0), strict=True):
        if end > begin:

            def derivative(_: float, y: np.ndarray, on: float = on) -> np.ndarray:
                return np.concatenate([[-on * flow], y[4:], [on * force / y[0], 0.0, 0.0]])

            state = solve_ivp(derivative, (begin, end), state, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(after.mass, state[0], atol=1e-12)
    np.testing.assert_allclose(after.r_ST_N, state[1:4], atol=1e-12)
    np.testing.assert_allclose(after.v_ST_N, state[4:], atol=1e-12)


@given(st.floats(0.0, 1.0), st.floats(0.0, 2.9))
def test_the_impulse_is_exactly_force_times_on_time_however_many_steps_it_spans(
    massless: PlantParams, at_rest: Truth, ignition: float, on_time: float
) -> None:
    cutoff = ignition + on_time
    after = simulate_burn(EFFECTS, massless, at_rest, np.float64(ignition), np.float64(cutoff))
    acceleration = 0.03 / 30.0
    gained = np.asarray(after.v_ST_N - at_rest.v_ST_N)
    moved = np.asarray(after.r_ST_N - at_rest.r_ST_N - BURN_STEPS * STEP * at_rest.v_ST_N)
    on_time = cutoff - ignition  # as rounded
    np.testing.assert_allclose(gained, [acceleration * on_time, 0.0, 0.0], atol=1e-16 * BURN_STEPS)
    mean_time_left = BURN_STEPS * STEP - 0.5 * (ignition + cutoff)
    np.testing.assert_allclose(moved, [acceleration * on_time * mean_time_left, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(after.delta_v, acceleration * on_time, atol=1e-16 * BURN_STEPS)


@pytest.mark.parametrize(("ignition", "cutoff"), [(0.3, 0.37), (0.35, 2.11), (-1.0, 1.05)])
def test_the_derivative_of_the_final_velocity_is_the_acceleration(
    massless: PlantParams, at_rest: Truth, ignition: float, cutoff: float
) -> None:
    to_ignition, to_cutoff = final_velocity_derivative(
        EFFECTS, massless, at_rest, np.float64(ignition), np.float64(cutoff)
    )
    np.testing.assert_allclose(to_cutoff, [0.001, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(to_ignition, [-0.001 if ignition > 0.0 else 0.0, 0.0, 0.0], atol=1e-15)


def test_propellant_and_velocity_change_obey_the_rocket_equation(balanced: PlantParams, at_rest: Truth) -> None:
    # A thousandth of the specific impulse makes the mass change ten per cent.
    thirsty = replace(balanced, thruster=replace(balanced.thruster, specific_impulse=jnp.float64(0.01)))
    after = simulate_burn(EFFECTS, thirsty, at_rest, np.float64(0.3), np.float64(3.3))
    used = 0.03 * 3.0 / (0.01 * G0)
    np.testing.assert_allclose(at_rest.mass - after.mass, used, rtol=1e-12)
    expected = 0.01 * G0 * np.log(30.0 / (30.0 - used))
    # The mass varies inside a step as well, by half a per cent; the stage factors are exact for constant mass only.
    np.testing.assert_allclose(after.delta_v, expected, rtol=1e-5)


def test_a_burn_off_the_centre_of_mass_gives_the_torque_of_its_lever_arm(params: Params, at_rest: Truth) -> None:
    offset = replace(params.plant, thruster=replace(params.plant.thruster, position=jnp.array([-0.25, 0.002, 0.0])))
    after = advance(EFFECTS, offset, at_rest, thrusts=(step_thrust(offset, -1.0, 1.0),))
    torque = np.cross([-0.25, 0.002, 0.0], [0.03, 0.0, 0.0])
    wheels = params.plant.wheels
    momentum = np.asarray(params.plant.servicer.inertia) @ after.omega_BN_B + wheels.inertia * after.wheel_speed
    np.testing.assert_allclose(momentum, torque * STEP, rtol=1e-6, atol=1e-12)  # the rotation meanwhile is negligible


def test_single_precision_agrees_with_double_over_a_minute_of_thrust(params: Params, in_orbit: Truth) -> None:
    effects = Effects(drag=True, sun_gravity=True, moon_gravity=True)

    def minute(params: PlantParams, truth: Truth, sky: SunMoonPositions, health: Health) -> Truth:
        pushes = (step_thrust(params, -1.0, 100.0, effects),)

        def body(truth: Truth, _: None) -> tuple[Truth, None]:
            return plant.step(effects, params, truth, jnp.zeros(3), pushes, sky, health, STEP), None

        return jax.lax.scan(body, truth, None, length=300)[0]

    double = jax.jit(minute)(params.plant, in_orbit, SKY, HEALTHY)
    near = single_precision.round_to_single(in_orbit)
    orbits = (in_orbit.r_TN_N - near.r_TN_N.astype(float), in_orbit.v_TN_N - near.v_TN_N.astype(float))
    start = replace(
        near, orbit_low=single_precision.round_to_single(jnp.stack(orbits)), mass_low=jnp.zeros((), jnp.float32)
    )
    single_inputs = single_precision.round_to_single(jax.tree.map(jnp.asarray, (params.plant, SKY, HEALTHY)))
    with single_precision.tracing_in_single():
        single = jax.jit(minute)(single_inputs[0], start, *single_inputs[1:])
    whole = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=np.float64), single)
    assert single.r_TN_N.dtype == np.float32
    assert whole.orbit_low is not None
    assert whole.mass_low is not None
    # The rounding of mu, 2e-7 m/s^2, bends both orbits alike.
    np.testing.assert_allclose(whole.r_TN_N + whole.orbit_low[0], double.r_TN_N, rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(whole.v_TN_N + whole.orbit_low[1], double.v_TN_N, rtol=0.0, atol=2e-5)
    np.testing.assert_allclose(whole.r_ST_N, double.r_ST_N, rtol=0.0, atol=2e-5)
    np.testing.assert_allclose(whole.delta_v, double.delta_v, rtol=1e-5)
    used = float(start.mass) - whole.mass - whole.mass_low
    np.testing.assert_allclose(used, in_orbit.mass - double.mass, rtol=1e-5)


def test_a_plume_gives_the_target_its_impulse_and_angular_impulse(params: Params, far_away: Truth) -> None:
    plant_params = replace(
        params.plant, facets=plume_impingement.facets_of(hull_triangles(np.asarray(params.plant.target.hull)))
    )
    start = replace(far_away, omega_TN_T=jnp.zeros(3), plume_impulse=jnp.zeros(()))
    load = Impingement(
        force_N=jnp.array([[0.01, -0.02, 0.03]]), torque_T=jnp.array([[1e-5, 2e-5, -3e-5]]), size=jnp.array([0.04])
    )
    open_valve = RcsState(
        force_B=jnp.zeros((1, 3)),
        position_B=jnp.zeros((1, 3)),
        mass_flow=jnp.zeros(1),
        ratio=jnp.ones(1),
        plume=load,
    )
    on_time = 0.4 * STEP

    def after(state: RcsState) -> Truth:
        thrust = rcs_thrusters.thrust_over_step(state, jnp.array([on_time]), "rk4", STEP)
        return step(EFFECTS, plant_params, start, np.zeros(3), (), SKY, HEALTHY, STEP, thrust)

    pushed, calm = after(open_valve), after(replace(open_valve, plume=replace(load, force_N=jnp.zeros((1, 3)))))
    mass, inertia = float(params.plant.target.mass), np.asarray(params.plant.target.inertia)
    velocity = np.asarray(load.force_N[0]) * on_time / mass
    np.testing.assert_allclose(pushed.v_TN_N - calm.v_TN_N, velocity, rtol=1e-6, atol=1e-12)
    # The servicer stays where it is, so that it moves the other way from the target.
    np.testing.assert_allclose(pushed.v_ST_N - calm.v_ST_N, -velocity, rtol=1e-6, atol=1e-12)
    rate = np.linalg.solve(inertia, np.asarray(load.torque_T[0])) * on_time
    np.testing.assert_allclose(pushed.omega_TN_T, rate, rtol=1e-5)
    assert float(pushed.plume_impulse) == pytest.approx(0.04 * on_time, rel=1e-12)
