"""Synthetic runs whose metric is a quadratic function of the inputs, for tests of tuning."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator, RolloutResult
from rpojax.runtime.device_mesh import DeviceMesh
from rpojax.scenario.schema import ScenarioFile

TUNED = ("attitude_control.bandwidth_rad_s", "navigation.gps_noise_m", "formation")
ONE_WEIGHT = (
    *(f"tuning.{name}=0" for name in ("innovations", "estimate", "consistency", "navigation", "delta_v", "pointing")),
    "tuning.formation=1",
)
"""Overrides that leave the formation error alone in the objective."""


class QuadraticRuns(RolloutEvaluator):
    """Runs whose formation error is least at known coordinates, with noise from their keys and some jumps.

    Derivatives to the weights of the control law, the last six, are those between two decisions: they point uphill.
    """

    best = np.array([0.5, -1.0, 0.3, 0.2, 0.1, 10.2, 10.1, 10.0])

    def __init__(
        self, file: ScenarioFile, input_function: Any, count: int, names: tuple[str, ...], *rest: Any, **further: Any
    ) -> None:
        self.input_count, self.metric_names, self.compile_s = count, names, 0.0
        self.program_memory_bytes, self.runs_per_device = 0, 64
        self._mesh = DeviceMesh(jax.devices()[:1])
        self._cotangent = rest[2]

    def _off(self, inputs: np.ndarray, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
        rng = np.random.default_rng(keys.astype(np.uint32).ravel().tolist())
        off = inputs - self.best + 0.1 * rng.standard_normal(inputs.shape)
        return off, np.exp(np.sum(off**2, axis=1, keepdims=True)), rng

    def evaluate(self, inputs: np.ndarray, keys: np.ndarray) -> RolloutResult:
        _, metrics, _ = self._off(inputs, keys)
        return RolloutResult(metrics, None, None, np.zeros(len(inputs), dtype=bool), np.zeros(len(inputs)))

    def gradient(self, inputs: np.ndarray, keys: np.ndarray, weights: np.ndarray | None = None) -> RolloutResult:
        off, metrics, rng = self._off(inputs, keys)
        cotangent = self._cotangent(jnp.asarray(metrics), jnp.ones(len(metrics)))
        gradient = np.asarray(cotangent) * metrics * 2.0 * off
        gradient[:, 2:] *= -3.0
        gradient[rng.random(len(gradient)) < 0.05] *= 1e4
        gradient[0, 0] = np.nan
        return RolloutResult(metrics, None, gradient, np.zeros(len(inputs), dtype=bool), np.zeros(len(inputs)))
