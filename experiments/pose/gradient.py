"""Derivatives of the error of the docking axis with respect to noises, against central differences.

    python -m experiments.pose.gradient [--runs 8] [--seed 0] [--horizon 300]

The runs are those of `pose_inspection`, cut short. `landmarks.noise_px` is what the landmarks have,
`navigation.tumble_walk_deg_s_sqrt_s` what the filter believes of the rate. Gates are the steps that they are. The exit
status is 1 where a difference of runs with the same events is further than 1e-3 from the derivative.
"""

import argparse
import sys
from typing import Final

import jax
import jax.numpy as jnp
import numpy as np

import rpojax
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.analysis.gradients.scenario_gradient import Gradient
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.simulation.noise import run_keys

METRIC: Final = "docking_axis_error_deg"
KEYS: Final = {"landmarks.noise_px": 1e-6, "navigation.tumble_walk_deg_s_sqrt_s": 1e-8}
"""Keys, and steps of the differences in their units."""
TOLERANCE: Final = 1e-3


def main() -> int:
    """Prints one row for each key and whether its derivative holds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--horizon", type=float, default=300.0)
    options = parser.parse_args()
    rpojax.prepare_process()
    overrides = [f"duration_s={options.horizon}", f"limits.arrive_by_s={options.horizon}"]
    file = rpojax.load("pose_inspection", overrides)
    found = rpojax.gradient(file, list(KEYS), [METRIC], runs=options.runs, seed=options.seed, gates="steps")

    def values(shift: jax.Array, run_key: jax.Array) -> Values:
        drawn = dispersed_values.draw(file, run_key, {})
        for number, key in enumerate(KEYS):
            section, name = key.split(".")
            drawn[key] = drawn.get(key, jnp.asarray(getattr(getattr(file, section), name))) + shift[number]
        return drawn

    steps = np.diag(list(KEYS.values()))
    shifts = np.concatenate([np.zeros((1, len(KEYS))), steps, -steps])
    keys = run_keys(options.seed, np.arange(options.runs))
    evaluator = RolloutEvaluator(file, values, len(KEYS), [METRIC], len(shifts) * options.runs)
    runs = evaluator.evaluate(np.repeat(shifts, options.runs, axis=0), np.tile(keys, (len(shifts), 1)))
    metrics, events = (each.reshape(len(shifts), options.runs) for each in (runs.metrics[:, 0], runs.events))
    held = [_holds(found, key, metrics, events, number) for number, key in enumerate(KEYS)]
    return int(not all(held))


def _holds(found: Gradient, key: str, metrics: np.ndarray, events: np.ndarray, number: int) -> bool:
    """Prints how far the derivative is from the difference of runs with the same events, and whether it holds."""
    derivative = found.derivatives[METRIC][key]
    ahead, behind = 1 + number, 1 + len(KEYS) + number
    central = (metrics[ahead] - metrics[behind]) / (2.0 * KEYS[key])
    quiet = (events[ahead] == events[0]) & (events[behind] == events[0]) & np.isfinite(central)
    error = np.abs(derivative - central)[quiet] / np.abs(central[quiet])
    sizes = np.abs(central[quiet])
    print(f"{key}: {quiet.sum()} of {len(quiet)} runs, derivative {sizes.min():.2e} to {sizes.max():.2e}, ", end="")
    print(f"relative difference {np.median(error):.1e} in the median, {error.max():.1e} at most")
    return bool(quiet.any() and error.max() < TOLERANCE)


if __name__ == "__main__":
    sys.exit(main())
