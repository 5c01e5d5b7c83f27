"""Runs of a small linear system in place of the closed loop, on any number of devices and in any number of batches.

As a script: gradients of an objective of tuning in every such way, as JSON.
"""

import json
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import rpojax
from rpojax.analysis.gradients import rollout_evaluator
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator, RunStatus, checkpointed_scan
from rpojax.analysis.gradients.tuning import gradient_descent
from rpojax.analysis.gradients.tuning.tuning_objective import PART_METRICS, Objective
from rpojax.scenario.params import Params
from rpojax.simulation.noise import run_keys

RUNS, TICKS = 7, 20
START = np.array([0.3, -0.2, 0.5])
TRANSITION = np.array([[0.9, 0.1, 0.0], [-0.2, 0.8, 0.1], [0.0, 0.1, 0.7]])
OFFSETS = np.array([40.0, 20.0, 20.0, 20.0])
UNDEFINED_RUN, FAILED_RUN = 2, 5
"""One has no pointing error; the other becomes non-finite, and so do its derivatives."""
DIVISIONS = [(1, 7), (1, 3), (2, 2), (3, 1)]
"""Devices, and runs that each takes at once; the last batch of most of them is padded."""
PARTS = ("formation", "consistency", "pointing")


class LinearRuns(RolloutEvaluator):
    """Runs with x <- A x + u + b of the run for some ticks, whose metrics are linear functions of the final state."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.special_keys = run_keys(0, np.array([UNDEFINED_RUN, FAILED_RUN]))

    def _simulate_metrics(
        self, nominal: Params, inputs: Array, keys: Array, checkpoint_ticks: int = 0
    ) -> tuple[Array, RunStatus]:
        def metrics(u: Array, key: Array) -> Array:
            own, outputs = parts_of_run(key)
            last = checkpointed_scan(
                lambda x: jnp.asarray(TRANSITION) @ x + u + own, jnp.zeros(3), TICKS, checkpoint_ticks
            )
            return outputs @ last + jnp.asarray(OFFSETS)

        found = jax.vmap(metrics)(inputs, keys)
        undefined, failed = (jnp.all(keys == key[None], axis=1) for key in self.special_keys)
        found = found.at[:, self.metric_names.index("pointing_error_rms_deg")].set(
            jnp.where(undefined, jnp.nan, found[:, -1])
        )
        root = jnp.sqrt(jnp.where(failed, 0.0, 1.0) * inputs[:, 0] ** 2)
        found = found + (root - jnp.abs(inputs[:, 0]))[:, None]
        return found, (failed, jnp.zeros(len(keys), dtype=jnp.uint32))


def parts_of_run(key: Array) -> tuple[Array, Array]:
    """Constant input (3,) of a run, and the outputs (4, 3) that are its metrics."""
    own, outputs = jax.random.split(key)
    return jax.random.normal(own, (3,)), 0.2 * jax.random.normal(outputs, (4, 3))


def objective() -> Objective:
    """Parts whose value is not the mean of those of batches, one of them undefined in a run."""
    return Objective(rpojax.load("inspection", [f"tuning.{name}={float(name in PARTS)}" for name in PART_METRICS]))


def tuning_gradient(devices: int, per_device: int, mode: str) -> dict[str, Any]:
    """Gradient of the objective, its norm, and the Jacobian of a metric, of runs divided in one way."""
    made = objective()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(rollout_evaluator, "share_runs", lambda *_: (jax.devices()[:devices], per_device))
        patched.setattr(gradient_descent, "FORWARD_MODE_MAX_INPUTS", 3 if mode == "forward" else 0)
        file = rpojax.load("inspection", ["duration_s=20"])
        evaluator = LinearRuns(file, lambda x, key: {}, 3, made.metric_names, RUNS, None, made.gradient)
        keys, smooth = run_keys(0, np.arange(RUNS)), np.zeros(3, dtype=bool)
        found = gradient_descent.estimate_gradient(evaluator, made, smooth, START, keys)
        inputs = np.tile(START, (RUNS, 1))
        if mode == "forward":
            jacobian = evaluator.jacobian(inputs, keys).jacobian
            of_metric = None if jacobian is None else jacobian[:, 0]
        else:
            of_metric = evaluator.gradient(inputs, keys, np.tile(np.eye(len(made.metric_names))[0], (RUNS, 1))).gradient
    assert of_metric is not None
    return {
        "division": [devices, per_device, mode],
        "metrics": found.metrics.tolist(),
        "gradient": found.gradient.tolist(),
        "excluded": found.excluded_runs,
        "of_metric": of_metric.tolist(),
    }


if __name__ == "__main__":
    print(json.dumps([tuning_gradient(*each, mode) for each in DIVISIONS for mode in ("forward", "reverse")]))
