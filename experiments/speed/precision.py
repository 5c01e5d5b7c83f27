"""Campaigns in single precision against the same runs in double precision: how far their metrics are apart."""

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
"""Packaged scenarios, and how long they are flown [s]."""


def compare(name: str, duration_s: int, runs: int, seed: int) -> str:
    """A row of the table."""
    from rpojax.analysis.gradients import tuning_validation

    double, single = (
        tuning_validation.simulate_runs(
            rpojax.load(name, [f"duration_s={duration_s}", f"precision={kind}"]), seed, runs
        )
        for kind in ("double", "single")
    )
    means, strays = {}, {}
    for metric, values in double.metrics.items():
        there = np.isfinite(values)
        if not np.array_equal(there, np.isfinite(single.metrics[metric])):
            means[metric] = np.inf
        elif there.sum() > 1 and (spread := float(np.std(values[there], ddof=1))) > 0.0:
            apart = single.metrics[metric][there] - values[there]
            means[metric] = abs(float(np.mean(apart))) / (1.96 * spread / np.sqrt(there.sum()))
            strays[metric] = float(np.median(np.abs(apart))) / spread
    worst, strayed = (max(each, key=lambda metric: each[metric]) for each in (means, strays))
    alike = "the same" if np.array_equal(double.completed, single.completed) else "**others**"
    return (
        f"| `{name}`, {duration_s:,} s | {alike} | {means[worst]:.3f} (`{worst}`) | {means['nees_mean']:.4f} "
        f"| {strays[strayed]:.4f} (`{strayed}`) |"
    )


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", nargs="*", help="NAME:SECONDS; all packaged scenarios unless given")
    parser.add_argument("--runs", type=int, default=128)
    parser.add_argument("--seed", type=int, default=5)
    chosen = parser.parse_args()
    prepare_jax(cache=True)
    set_loop_fusion_flag(rendered=False)
    print("| scenario | runs that complete | farthest mean | mean NEES | farthest runs |")
    print("|---|---|---|---|---|")
    asked = [text.partition(":") for text in chosen.missions]
    for name, duration_s in {name: int(seconds) for name, _, seconds in asked}.items() or MISSIONS.items():
        print(compare(name, duration_s, chosen.runs, chosen.seed), flush=True)


if __name__ == "__main__":
    main()
