"""Gradient of a metric of many runs in reverse mode."""

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.accelerator import memory
from benchmarks.accelerator.sizes import Sizes
from rpojax.analysis.gradients.rollout_evaluator import InputFunction, RolloutEvaluator
from rpojax.benchmark import timing
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.noise import run_keys

_METRIC = "formation_error_rms_m"
_KEY = "formation.delta_v_weight"


def measure(sizes: Sizes) -> Iterator[dict[str, Any]]:
    """One entry: compilation, a gradient of all runs, the same without derivatives."""
    file = scenario_loader.load("inspection", [f"duration_s={sizes.gradient_duration_s}"])
    yield memory.measured_or_reason(lambda: _figures(file, sizes.gradient_runs), runs=sizes.gradient_runs)


def _figures(file: ScenarioFile, runs: int) -> dict[str, Any]:
    evaluator = RolloutEvaluator(file, _shifted_weight(file), 3, [_METRIC], runs)
    inputs, weights = np.zeros((runs, 3)), np.ones((runs, 1))
    keys = run_keys(0, np.arange(runs))
    gradient = timing.fastest_pass(lambda: timing.time_call(lambda: evaluator.gradient(inputs, keys, weights)), 2)
    compile_s = evaluator.compile_s
    values = timing.fastest_pass(lambda: timing.time_call(lambda: evaluator.evaluate(inputs, keys)), 2)
    return {
        "duration_s": file.duration_s,
        "compile_s": compile_s,
        "gradient_s": gradient.wall_s,
        "values_s": values.wall_s,
        "run_seconds_per_s": runs * file.duration_s / gradient.wall_s,
        "program_bytes_per_run": evaluator.program_memory_bytes / runs,
        "peak_device_bytes": memory.peak_bytes(),
    }


def _shifted_weight(file: ScenarioFile) -> InputFunction:
    """Dispersed values of a run, with a shift of the weights of velocity changes."""
    nominal = np.asarray(file.formation.delta_v_weight, dtype=np.float64)

    def values(shift: jax.Array, key: jax.Array) -> dispersed_values.Values:
        return {**dispersed_values.draw(file, key, {}), _KEY: jnp.asarray(nominal) + shift}

    return values
