"""Formation law: LQR gain against the textbook, stability of the closed loop, and derivatives against differences."""

import itertools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from rpojax.core.orbits.clohessy_wiltshire import transition_matrix
from rpojax.core.pytree import replace
from rpojax.flight.control import formation_law
from rpojax.flight.control.formation_law import lqr_gain
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.scenario.params import Params

RATE = np.float64(1.1e-3)  # mean motion at 500 km
PERIOD = 200.0
RICCATI = 1e-9  # both solvers are good to the conditioning of the solution, 1e6, times rounding
compiled_gain = jax.jit(lqr_gain, static_argnums=2)
Problem = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def relative_motion(period: float, weights: tuple[float, float, float]) -> Problem:
    A = np.asarray(transition_matrix(jnp.asarray(RATE), jnp.asarray(period)))
    position, velocity, delta_v = weights
    return A, A[:, 3:], np.diag([position] * 3 + [velocity] * 3), delta_v * np.eye(3)


def closed_loop_radius(formation: FormationTuning) -> float:
    A = np.asarray(transition_matrix(jnp.asarray(RATE), jnp.asarray(PERIOD)))
    gain = np.asarray(compiled_gain(formation, RATE, PERIOD))
    return float(np.max(np.abs(np.linalg.eigvals(A - A[:, 3:] @ gain))))


@pytest.mark.parametrize("delta_v_weight", [1.0, 3e4, 1e6])
def test_the_closed_loop_is_stable_for_low_and_high_control_weights(params: Params, delta_v_weight: float) -> None:
    formation = replace(params.flight.formation, delta_v_weight=jnp.full(3, delta_v_weight))
    assert closed_loop_radius(formation) < 1.0


def test_lower_control_weight_gives_faster_poles(params: Params) -> None:
    formations = [replace(params.flight.formation, delta_v_weight=jnp.full(3, w)) for w in (1e2, 1e4, 1e6)]
    radii = [closed_loop_radius(formation) for formation in formations]
    assert radii == sorted(radii)


def test_the_gain_agrees_with_scipys_riccati_solution(params: Params) -> None:
    A, B, Q, R = relative_motion(PERIOD, (1.0, 0.0, 3e4))
    P = solve_discrete_are(A, B, Q, R)
    expected = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    found = compiled_gain(params.flight.formation, RATE, PERIOD)
    np.testing.assert_allclose(found, expected, atol=RICCATI * np.max(np.abs(expected)))


WEIGHTS = ("position_weight", "velocity_weight", "delta_v_weight")


@jax.jit
def gain_of_weights(formation: FormationTuning, weights: dict[str, jax.Array]) -> jax.Array:
    return compiled_gain(replace(formation, **weights), jnp.asarray(RATE), PERIOD)


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev], ids=["forward", "reverse"])
def test_the_derivative_of_the_gain_agrees_with_central_differences(
    params: Params, mode: Callable[..., Callable[..., dict[str, jax.Array]]]
) -> None:
    formation = replace(params.flight.formation, velocity_weight=jnp.full(3, 1e3))
    weights = {name: np.asarray(getattr(formation, name)) for name in WEIGHTS}
    derivatives = jax.jit(mode(gain_of_weights, argnums=1))(formation, weights)
    for name, axis in itertools.product(WEIGHTS, range(3)):
        h = 1e-4 * weights[name][axis] * np.eye(3)[axis]
        above, below = (
            np.asarray(gain_of_weights(formation, {**weights, name: weights[name] + s * h})) for s in (1, -1)
        )
        derivative = np.asarray(derivatives[name])
        # Truncation of the central difference (1e-4)^2, rounding 1e-12 / 1e-4.
        expected = (above - below) / (2 * h[axis])
        np.testing.assert_allclose(
            derivative[:, :, axis], expected, atol=1e-6 * np.max(np.abs(derivative)), err_msg=name
        )


def test_one_impulse_per_period_brings_the_servicer_to_its_station(params: Params) -> None:
    A = np.asarray(transition_matrix(jnp.asarray(RATE), jnp.asarray(PERIOD)))
    gain = np.asarray(compiled_gain(params.flight.formation, RATE, PERIOD))
    state = np.array([0.0, -20.0, 0.0, 0.0, 0.0, 0.0])
    for _ in range(30):
        state = A @ (state + np.concatenate([np.zeros(3), -gain @ state]))
    assert np.linalg.norm(state[:3]) < 0.01 * 20.0


def test_the_velocity_change_is_minus_the_gain_times_the_deviation() -> None:
    rng = np.random.default_rng(3)
    gain, deviation = rng.normal(size=(3, 6)), rng.normal(size=6)
    found = formation_law.lqr_feedback(jnp.asarray(gain), jnp.asarray(deviation))
    np.testing.assert_allclose(found, -gain @ deviation, rtol=1e-13)
