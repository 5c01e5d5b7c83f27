"""Differences of metrics between single and double precision, for the same runs."""

import argparse

import numpy as np

import rpojax
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

MISSIONS = {
    "inspection": 6000,
    "inspection_full": 2000,
    "inspection_eclipse": 4000,
    "inspection_faults": 2000,
    "inspection_radial": 3000,
    "inspection_cold": 3000,
}
"""Packaged scenario -> simulated duration [s]."""


def compare(name: str, duration_s: int, runs: int, seed: int) -> str:
    """Row of the table for a scenario."""
    from rpojax.analysis.gradients.tuning import tune

    double, single = (
        tune.simulate_runs(rpojax.load(name, [f"duration_s={duration_s}", f"precision={kind}"]), seed, runs)
        for kind in ("double", "single")
    )
    mean_differences, run_differences = {}, {}
    for metric, values in double.metrics.items():
        defined = np.isfinite(values)
        if not np.array_equal(defined, np.isfinite(single.metrics[metric])):
            mean_differences[metric] = np.inf
        elif defined.sum() > 1 and (spread := float(np.std(values[defined], ddof=1))) > 0.0:
            difference = single.metrics[metric][defined] - values[defined]
            mean_differences[metric] = abs(float(np.mean(difference))) / (1.96 * spread / np.sqrt(defined.sum()))
            run_differences[metric] = float(np.median(np.abs(difference))) / spread
    worst_mean, worst_run = (max(each, key=lambda metric: each[metric]) for each in (mean_differences, run_differences))
    completed = "the same" if np.array_equal(double.failed, single.failed) else "**different**"
    mean = f"{mean_differences[worst_mean]:.3f} (`{worst_mean}`)"
    run = f"{run_differences[worst_run]:.4f} (`{worst_run}`)"
    return f"| `{name}`, {duration_s:,} s | {completed} | {mean} | {mean_differences['nees_mean']:.4f} | {run} |"


def main() -> None:
    """Prints a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", nargs="*", help="NAME:SECONDS; default: all packaged scenarios")
    parser.add_argument("--runs", type=int, default=128)
    parser.add_argument("--seed", type=int, default=5)
    options = parser.parse_args()
    prepare_jax(cache=True)
    set_loop_fusion_flag(rendered=False)
    print("| scenario | runs that complete | largest difference of a mean | mean NEES | largest difference of runs |")
    print("|---|---|---|---|---|")
    pairs = [text.partition(":") for text in options.missions]
    for name, duration_s in {name: int(seconds) for name, _, seconds in pairs}.items() or MISSIONS.items():
        print(compare(name, duration_s, options.runs, options.seed), flush=True)


if __name__ == "__main__":
    main()
