"""Gradients of formation error and velocity change to the numbers that decide on burns: derivatives and differences.

    python experiments/tuning/decisions.py [--runs 128] [--horizon 4000]

All gradients are those of the mean logarithm to a number's coordinate. The derivative of each run is exact between two
of its decisions; its mean over runs is given with its standard error, and also with gradients clipped as in tuning.
"""

import argparse
from functools import partial

import numpy as np

from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

PARAMETERS = ("formation", "schedule")
SETTINGS = ("formation.velocity_weight=[1e3, 1e3, 1e3]", "tuning.formation=1", "tuning.delta_v=1")
ONLY = tuple(f"tuning.{name}=0" for name in ("innovations", "estimate", "consistency", "navigation", "pointing"))
SPANS = (0.1, 0.4)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=128)
    parser.add_argument("--horizon", type=float, default=4000.0)
    parser.add_argument("--seed", type=int, default=5)
    options = parser.parse_args()
    prepare_jax(cache=True)
    set_loop_fusion_flag(rendered=False)
    import rpojax
    from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
    from rpojax.analysis.gradients.tuning import gradient_descent, tunable_parameters
    from rpojax.analysis.gradients.tuning.tuning_objective import Objective
    from rpojax.simulation.noise import run_keys

    file = rpojax.load("inspection", [*SETTINGS, *ONLY, f"duration_s={options.horizon}"])
    chosen, names = tunable_parameters.select_parameters(file, PARAMETERS), Objective(file).metric_names
    evaluator = RolloutEvaluator(
        file, partial(tunable_parameters.run_values, file, chosen), chosen.count, names, options.runs
    )
    keys = run_keys(options.seed, np.arange(options.runs))

    def logs(x: np.ndarray) -> np.ndarray:
        return np.log(evaluator.evaluate(np.tile(x, (options.runs, 1)), keys).metrics)

    here = logs(chosen.initial)
    sides = {
        (index, span): tuple(logs(chosen.initial + sign * span * np.eye(chosen.count)[index]) for sign in (1.0, -1.0))
        for index in range(chosen.count)
        for span in SPANS
    }
    for column, metric in enumerate(names):
        weights = np.zeros_like(here)
        weights[:, column] = np.exp(-here[:, column])
        found = evaluator.gradient(np.tile(chosen.initial, (options.runs, 1)), keys, weights).gradient
        assert found is not None
        clipped, _, clipped_runs = gradient_descent.clipped_sum(found / options.runs)
        print(f"\n`{metric}`, {clipped_runs} of {options.runs} gradients clipped\n")
        spans = " | ".join(f"differences over {span:g}" for span in SPANS)
        print(f"| number | mean derivative | clipped | median | {spans} |\n|---|---|---|---|{'---|' * len(SPANS)}")
        for index, name in enumerate(chosen.names):
            gradient = found[:, index]
            cells = [with_error(gradient), f"{clipped[index]:.2f}", f"{np.median(gradient):.3f}"]
            for span in SPANS:
                up, down = sides[index, span]
                cells.append(with_error((up - down)[:, column] / (2.0 * span)))
            print(f"| `{name}` | {' | '.join(cells)} |", flush=True)


def with_error(values: np.ndarray) -> str:
    """Mean and its standard error."""
    return f"{values.mean():.3f} ± {values.std() / np.sqrt(len(values)):.3f}"


if __name__ == "__main__":
    main()
