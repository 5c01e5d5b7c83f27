"""Derivatives of the errors at 3 m with respect to a thruster's misalignment, against central differences.

python experiments/close_range/gradient.py [--runs 8] [--seed 0] [--thruster t01] [--slopes]

The runs are those of `short_approach.toml`. Differences are taken with steps over seven decades: small ones show the
derivative of the run as its decisions are, large ones change pulses, gates and the instant of the last phase, and jump.
Gates are the steps that they are (`gates="steps"` of `rpojax.gradient`); with `--slopes` the filter's gates have a
slope, which no difference of runs has. The exit status is 1 if the differences with a step of 1e-5 deg are further
than 1e-3 from the derivative.
"""

import argparse
import sys
from pathlib import Path
from typing import Final

import jax
import jax.numpy as jnp
import numpy as np

import rpojax
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.noise import run_keys

METRICS: Final = ("final_lateral_error_m", "final_range_error_m")
STEPS_DEG: Final = 10.0 ** np.arange(-7.0, 1.0)
CHECKED_DEG: Final = 1e-5
"""Step that is held against the derivative [deg]: the errors of rounding are 1e-7 of the difference."""
TOLERANCE: Final = 1e-3
"""Greatest difference over the size of the derivative [-]."""


def main() -> int:
    """Prints one row for each step and whether the derivative holds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--thruster", default="t01")
    parser.add_argument("--slopes", action="store_true", help="gates with slopes")
    options = parser.parse_args()
    rpojax.prepare_process()
    file = rpojax.load(Path(__file__).with_name("short_approach.toml"))
    key = f"thrusters.{options.thruster}.misalignment_deg"
    gates = "slopes" if options.slopes else "steps"
    found = rpojax.gradient(file, [key], METRICS, runs=options.runs, seed=options.seed, gates=gates)
    metrics, events = _at_steps(file, key, options.runs, options.seed)
    holds = True
    for number, name in enumerate(METRICS):
        derivative = found.derivatives[name][key]
        counted = found.counts(name)
        print(f"\n{name}: {counted.sum()} of {options.runs} runs, {found.mode} mode")
        print(f"sizes of the derivatives {_range(np.linalg.norm(derivative[counted], axis=1))} m/deg")
        print("step [deg]   largest, median difference [relative]   beyond 1e-3   events equal")
        for place, step in enumerate(STEPS_DEG):
            differences = (metrics[place, 0, ..., number] - metrics[place, 1, ..., number]) / (2.0 * step)
            off = _relative(differences.T, derivative)[counted]
            same = np.mean(events[place][:, :, counted] == found.events[counted])
            beyond = int(np.sum(~(off <= TOLERANCE)))
            print(
                f"{step:9.0e}    {np.nanmax(off):.1e}  {np.nanmedian(off):.1e}    {beyond} of {off.size}   {same:.0%}"
            )
            if step == CHECKED_DEG:
                holds &= beyond == 0
    return int(not holds)


def _at_steps(file: ScenarioFile, key: str, runs: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Metrics (steps, 2, 3, runs, metrics) and events (steps, 2, 3, runs) of runs with a shifted component of a key."""

    def values(shift: jax.Array, run_key: jax.Array) -> Values:
        drawn = dispersed_values.draw(file, run_key, {})
        return {**drawn, key: drawn.get(key, jnp.zeros(3)) + shift}

    shifts = STEPS_DEG[:, None, None, None] * np.array([1.0, -1.0])[:, None, None] * np.eye(3)
    shape = (*shifts.shape[:3], runs)
    inputs = np.repeat(shifts.reshape(-1, 3), runs, axis=0)
    keys = np.tile(run_keys(seed, np.arange(runs)), (len(inputs) // runs, 1))
    found = RolloutEvaluator(file, values, 3, METRICS, len(inputs)).evaluate(inputs, keys)
    return found.metrics.reshape(*shape, len(METRICS)), found.events.reshape(shape)


def _relative(differences: np.ndarray, derivative: np.ndarray) -> np.ndarray:
    """Distance (runs, 3) of components over the size of the derivative of the run."""
    return np.abs(differences - derivative) / np.linalg.norm(derivative, axis=1, keepdims=True)


def _range(values: np.ndarray) -> str:
    return f"{values.min():.1e} to {values.max():.1e}"


if __name__ == "__main__":
    sys.exit(main())
