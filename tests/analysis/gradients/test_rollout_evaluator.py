"""Metrics of short runs and their derivatives, in both modes, against central differences."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import rpojax
from rpojax.analysis.gradients import rollout_evaluator
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.noise import run_keys

pytestmark = pytest.mark.slow

NAMES = ("formation_error_rms_m", "nav_relative_position_error_rms_m", "estimate_surprise", "delta_v_m_s")
KEYS = ("navigation.edge_noise_px", "attitude_control.bandwidth_rad_s", "formation.delta_v_weight")
CALM = [
    "duration_s=240.0",
    "rates.formation_period_s=120.0",
    "camera.outlier_probability=0.0",
    "formation.dead_band_mm_s=0.0",
    "navigation.gating=none",
]


def scaled(file: ScenarioFile) -> rollout_evaluator.InputFunction:
    """Inputs that scale three numbers of flight software."""
    nominal = [jnp.asarray([1.0]), jnp.asarray([0.5]), jnp.asarray([3e4, 3e4, 3e4])]

    def inputs(x: jax.Array, key: jax.Array) -> dispersed_values.Values:
        values = dispersed_values.draw(file, key, {})
        for index, name in enumerate(KEYS):
            value = nominal[index] * jnp.exp(x[index])
            values[name] = value if name == KEYS[2] else value[0]
        return values

    return inputs


@cache
def evaluator() -> RolloutEvaluator:
    file = rpojax.load("inspection", CALM)
    return RolloutEvaluator(file, scaled(file), 3, NAMES, runs=3)


KEYS_OF_RUNS = run_keys(0, np.array([1, 5, 7]))


def forward(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Metrics (runs, metrics) and their Jacobian at inputs (k,)."""
    found = evaluator().jacobian(np.tile(x, (3, 1)), KEYS_OF_RUNS)
    assert found.jacobian is not None
    return found.metrics, found.jacobian


def test_the_forward_mode_agrees_with_differences() -> None:
    # Positions of seven thousand kilometres are rounded to a nanometre: over the step, a hundredth of a millimetre.
    step, rounding = 1e-4, 2e-5
    _, jacobian = forward(np.zeros(3))
    assert np.all(np.any(jacobian != 0.0, axis=(0, 1)))
    for index in range(3):
        up, down = (forward(sign * step * np.eye(3)[index])[0] for sign in (1.0, -1.0))
        np.testing.assert_allclose(jacobian[:, :, index], (up - down) / (2.0 * step), rtol=1e-3, atol=rounding)


@pytest.mark.parametrize("memory", [rollout_evaluator.CHECKPOINT_MEMORY_BYTES, 1])
def test_the_reverse_mode_agrees_with_the_forward_mode(memory: int) -> None:
    weights = np.ones((3, 4)) * np.array([1.0, 2.0, -1.0, 30.0])
    file = rpojax.load("inspection", CALM)
    checkpointed = RolloutEvaluator(file, scaled(file), 3, NAMES, runs=3, checkpoint_memory_bytes=memory)
    reverse = checkpointed.gradient(np.zeros((3, 3)), KEYS_OF_RUNS, weights)
    metrics, jacobian = forward(np.zeros(3))
    assert reverse.gradient is not None
    np.testing.assert_allclose(reverse.metrics, metrics, rtol=1e-9)
    np.testing.assert_allclose(reverse.gradient, np.einsum("rf,rfk->rk", weights, jacobian), rtol=1e-6, atol=1e-9)


def test_a_run_does_not_depend_on_the_others_of_its_batch() -> None:
    alone = evaluator().jacobian(np.zeros((1, 3)), KEYS_OF_RUNS[1:2]).metrics
    many = evaluator().jacobian(np.zeros((7, 3)), np.concatenate([KEYS_OF_RUNS, KEYS_OF_RUNS, KEYS_OF_RUNS[:1]]))
    assert many.metrics.shape == (7, 4)
    np.testing.assert_array_equal(alone[0], many.metrics[1])
    np.testing.assert_array_equal(many.metrics[:3], many.metrics[3:6])
