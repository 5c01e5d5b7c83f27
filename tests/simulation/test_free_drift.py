"""The range that free drift would reach, against the motion propagated in small steps, and its channel."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from numpy_reference import SEEDS

from rpojax.core.orbits import clohessy_wiltshire
from rpojax.scenario import params as parameters
from rpojax.scenario.loading import scenario_loader as scenarios
from rpojax.scenario.static_settings import static_settings
from rpojax.simulation import initial_state, telemetry
from rpojax.simulation.noise import run_key
from rpojax.simulation.state import State
from rpojax.simulation.telemetry import Telemetry

N = 1.107e-3
"""Mean motion at 500 km [rad/s]."""

minimum_drift_distance = jax.jit(clohessy_wiltshire.minimum_drift_distance)


def dynamics(n: float) -> np.ndarray:
    """Matrix of the Clohessy-Wiltshire equations."""
    A = np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    A[3, 0], A[3, 4], A[4, 3], A[5, 2] = 3.0 * n * n, 2.0 * n, -2.0 * n, -n * n
    return A


def brute_force(n: float, state: np.ndarray, steps: int) -> float:
    """Least distance over one orbit, one exponential of the equations a step."""
    transition = scipy.linalg.expm(dynamics(n) * 2.0 * np.pi / n / steps)
    least = np.inf
    for _ in range(steps + 1):
        least = min(least, np.linalg.norm(state[:3]))
        state = transition @ state
    return least


@given(SEEDS)
def test_the_closest_point_of_free_drift_is_that_of_the_propagated_equations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = N * rng.uniform(0.5, 1.5)
    state = np.concatenate([rng.uniform(-50.0, 50.0, 3), 0.03 * rng.normal(size=3)])
    found = float(minimum_drift_distance(n, state[:3], state[3:]))
    np.testing.assert_allclose(found, brute_force(n, state, 72), rtol=1e-9)  # the same 73 points
    # Between two points five degrees apart the way is at most its length: a bound on what may be missed.
    finest = brute_force(n, state, 2880)
    speed = np.linalg.norm(state[3:]) + 4.0 * n * np.linalg.norm(state[:3])
    assert finest <= found + 1e-9
    assert found - finest < 6.0 * speed * np.deg2rad(2.5) / n


@pytest.mark.parametrize(
    ("rho", "rho_dot", "closest", "tolerance"),
    [
        ([0.0, -30.0, 0.0], [0.0, 0.0, 0.0], 30.0, 1e-9),  # on the orbit it stays
        ([0.0, -30.0, 0.0], [0.0, 0.0, 0.02], 30.0, 1e-9),  # across it swings
        # It drifts 20 m an orbit, 3 v T, and has been half a metre further where cos(n t) is 3/4.
        ([0.0, -40.0, 0.0], [0.0, -20.0 / (6.0 * np.pi) * N, 0.0], 19.5008, 1e-4),
    ],
)
def test_the_closest_point_of_drifts_that_can_be_worked_out_on_paper(
    rho: list[float], rho_dot: list[float], closest: float, tolerance: float
) -> None:
    np.testing.assert_allclose(minimum_drift_distance(N, np.array(rho), np.array(rho_dot)), closest, rtol=tolerance)


@jax.jit
def passive_range(state: State, tick: jax.Array) -> jax.Array:
    """Channel of a tick in that state."""
    seen = Telemetry(
        truth=state.truth,
        flight=state.flight,
        frame=None,
        measurements=None,
        innovation=None,
        mode=jnp.zeros((), dtype=jnp.int32),
        tick=tick,
        running=jnp.asarray(True),
    )
    return telemetry._passive_range(seen)


@pytest.fixture(scope="module")
def start() -> State:
    """Start of a run on the orbit behind the target, drifting slowly."""
    file = scenarios.load("inspection", ["initial.relative_velocity_m_s=[0.0, 0.002, 0.0]"])
    static = static_settings(file)
    params = parameters.build_params(file.model_dump(), static.width_px, static.height_px)
    return jax.jit(initial_state.init, static_argnums=0)(static, params, run_key(1, 0))


def test_the_channel_looks_once_in_ten_ticks_and_is_infinite_in_between(start: State) -> None:
    found = [float(passive_range(start, jnp.int32(tick))) for tick in range(21)]
    assert [np.isfinite(value) for value in found] == [tick % 10 == 0 for tick in range(21)]
    n = np.sqrt(3.986004418e14 / 6878137.0**3)
    expected = brute_force(n, np.array([0.0, -50.0, 0.0, 0.0, 0.002, 0.0]), 72)
    # The orbit's eccentricity of 1e-3 changes the speed at perigee, from which the mean motion follows, by no more.
    np.testing.assert_allclose(found[10], expected, rtol=2e-3)
