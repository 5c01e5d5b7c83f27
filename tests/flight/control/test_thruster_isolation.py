"""Thrusters that are open without a command: found after some samples, never by noise alone, with a known impulse."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.pytree import replace
from rpojax.flight.control import rcs_control, thruster_allocation, thruster_isolation
from rpojax.flight.control.thruster_allocation import ThrusterLayout
from rpojax.flight.control.thruster_isolation import Isolation, IsolationTuning, OpenTime
from rpojax.flight.flight_records import FlightParams
from rpojax.sensors import chamber_pressure
from rpojax.sensors.chamber_pressure import ChamberPressure

STEP = 0.2
TUNING = IsolationTuning(pressure=jnp.array(0.3), samples=jnp.array(3.0))


def pair() -> ThrusterLayout:
    """Two of 0.3 N along x and 0.2 N along y."""
    direction, position = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[0.0, 0.5, 0.0], [0.0, 0.0, 1.0]])
    wrench = thruster_allocation.wrench_matrix(np.array([0.3, 0.2]), direction, position)
    return thruster_allocation.layout(wrench, np.array([1.0, 1.0]), np.array([0.02, 0.02]))


def watched(pressures: np.ndarray, on_times: np.ndarray | None = None) -> list[tuple[Isolation, OpenTime]]:
    """Knowledge and open times after each step, from pressures (steps, 2) and the on-times of pulses."""
    state, found = thruster_isolation.initial(pair()), []
    on_times = np.zeros_like(pressures) if on_times is None else on_times
    for number, (pressure, on_time) in enumerate(zip(pressures, on_times, strict=True)):
        end = jnp.asarray(STEP * (number + 1))
        state, opened = thruster_isolation.watch(TUNING, state, jnp.asarray(pressure), jnp.asarray(on_time), STEP, end)
        found.append((state, opened))
    return found


def of_second(*pressures: float) -> np.ndarray:
    """Pressures of a sound thruster and of another one."""
    return np.stack([np.zeros(len(pressures)), np.array(pressures)], axis=1)


def test_a_thruster_is_shut_off_with_the_third_sample_in_a_row_and_stays_so() -> None:
    states = watched(of_second(1.0, 1.0, 1.0, 1.0, 0.0, 0.0))
    shut = [np.array(thruster_isolation.is_shut_off(state)).tolist() for state, _ in states]
    assert shut == [[False, False]] * 2 + [[False, True]] * 4
    assert float(states[-1][0].shut_at[1]) == pytest.approx(3 * STEP)


@pytest.mark.parametrize("pressures", [(1.0, 1.0, 0.0, 1.0, 1.0), (0.3, 0.3, 0.3, 0.3, 0.3)])
def test_samples_that_are_interrupted_or_below_the_limit_shut_nothing_off(pressures: tuple[float, ...]) -> None:
    assert np.isinf(np.array(watched(of_second(*pressures))[-1][0].shut_at)).all()


def test_the_pressure_of_a_pulse_is_no_sign_and_interrupts_none() -> None:
    full = np.zeros((6, 2))
    full[:, 1] = STEP
    assert not np.array(thruster_isolation.is_shut_off(watched(of_second(*[1.0] * 6), full)[-1][0])).any()
    full[[0, 1, 4]] = 0.0
    states = watched(of_second(*[1.0] * 6), full)
    assert [bool(thruster_isolation.is_shut_off(state)[1]) for state, _ in states] == [False] * 4 + [True] * 2


def test_a_pulse_that_ends_within_the_step_leaves_the_rest_of_it_to_the_sample() -> None:
    on_times = np.full((3, 2), 0.05)
    states = watched(of_second(1.0, 1.0, 1.0), on_times)
    assert bool(thruster_isolation.is_shut_off(states[-1][0])[1])
    times = [float(opened.time[1]) for _, opened in states]
    assert times == pytest.approx([0.5 * 0.15, 0.15, 0.15])


def test_the_open_time_is_that_of_the_trapezoid_and_its_error_that_of_both_ends() -> None:
    opened = [each for _, each in watched(of_second(0.0, 1.0, 0.9, 1.1, 0.0, 0.0))]
    assert sum(float(each.time[1]) for each in opened) == pytest.approx(STEP * 3.0)
    assert sum(float(each.variance[1]) for each in opened) == pytest.approx(2.0 * STEP**2 / 12.0)
    assert all(float(each.time[0]) == float(each.variance[0]) == 0.0 for each in opened)


def test_the_open_time_of_a_burn_at_any_instant_has_the_declared_error() -> None:
    """Begin and end (s) within a step are uniform: the error of the trapezoid has the variance of both ends."""
    rng = np.random.default_rng(5)
    begin, duration = rng.uniform(0.0, STEP, 4000), rng.uniform(5 * STEP, 6 * STEP, 4000)
    ends = STEP * np.arange(1, 10)
    pressures = ((begin[:, None] <= ends) & ((begin + duration)[:, None] > ends)).astype(float)
    before = np.pad(pressures, ((0, 0), (1, 0)))[:, :-1]
    errors = STEP * np.sum(0.5 * (before + pressures), axis=1) - duration
    assert abs(errors.mean()) < 4.0 * np.sqrt(STEP**2 / 6.0 / 4000)
    assert errors.var() == pytest.approx(2.0 * STEP**2 / 12.0, rel=0.1)


@partial(jax.jit, static_argnums=1)
def _isolated_by_noise(key: jax.Array, steps: int, noise: float) -> jax.Array:
    """How many of 24 sound thrusters are shut off in a number of steps."""
    sensor, none = ChamberPressure(noise=jnp.asarray(noise)), jnp.zeros(24)
    layout = replace(pair(), cost=none + 1.0)

    def step(state: Isolation, number: jax.Array) -> tuple[Isolation, None]:
        normals = jax.random.normal(jax.random.fold_in(key, number), (24,))
        pressure = chamber_pressure.measure_at_rest(sensor, none, normals)
        return thruster_isolation.watch(TUNING, state, pressure, none, STEP, number.astype(float))[0], None

    state, _ = jax.lax.scan(step, thruster_isolation.initial(layout), jnp.arange(steps))
    return jnp.sum(thruster_isolation.is_shut_off(state))


def test_the_noise_of_the_sensor_never_isolates_a_sound_thruster() -> None:
    """4.8 million samples: 24 thrusters for eleven hours at 5 Hz; at ten times the noise they are isolated soon."""
    key = jax.random.key(3)
    assert int(_isolated_by_noise(key, 200_000, 0.03)) == 0
    assert int(_isolated_by_noise(key, 200_000, 0.3)) == 24


def test_an_isolated_thruster_gets_no_pulse_and_leaves_the_allocation() -> None:
    layout = pair()
    state = replace(thruster_isolation.initial(layout), shut_at=jnp.array([jnp.inf, 5.0]))
    given = replace(rcs_control.no_command(layout, isolates=True), isolation=state, shares=jnp.array([0.5, 0.5]))
    on_time, owed = rcs_control.pulses(layout, given, jnp.array([0.01, 0.01]), STEP, state)
    assert np.allclose(on_time, [0.11, 0.0])
    assert np.allclose(owed, 0.0)
    assert np.array_equal(rcs_control.shut_off(given).ratio, [1.0, 0.0])
    assert np.array_equal(rcs_control.shut_off(replace(given, isolation=None)).ratio, [1.0, 1.0])


def test_the_size_of_a_burn_has_the_errors_of_an_uncommanded_one(flight: FlightParams) -> None:
    """One of 0.3 N is open without a command for a second of a tick; each end of it is known to 0.2 s alone."""
    layout, mass, sigma = pair(), float(flight.vehicle.mass), float(flight.navigation.burn_magnitude_sigma)
    opened = OpenTime(time=jnp.array([1.0, 0.0]), variance=jnp.array([2.0 * STEP**2 / 12.0, 0.0]))
    delta_v_N = jnp.array([0.3 / mass, 0.0, 0.0])
    command = rcs_control.no_command(layout, isolates=True)
    size = rcs_control.burn_size(layout, flight.vehicle, command, opened, delta_v_N, flight.navigation, 1.0)
    variance = float(size) * 0.3 / mass * sigma**2
    by_hand = (0.3 / mass) ** 2 * (sigma**2 + 2.0 * STEP**2 / 12.0)
    assert variance == pytest.approx(by_hand, rel=1e-9)
    never = rcs_control.burn_size(layout, flight.vehicle, command, None, delta_v_N, flight.navigation, 1.0)
    assert float(never) == 0.0
