"""The last hundred metres with twelve thrusters: errors at 3 m, closing speed, and consistency of the filter.

python experiments/close_range/final_approach.py --out DIR [--scenario final_approach] [--runs 1000] [--seed 0]
    [--set KEY=VALUE ...]

The exit status is 1 if a run enters the keep-out sphere, or if a thruster that is stuck open is shut off too late.
"""

import argparse
import sys

import numpy as np

import rpojax

ARRIVAL = ("final_lateral_error_m", "final_range_error_m", "closing_speed_max_m_s", "min_range_m", "delta_v_m_s")

LATEST_ISOLATION_S = 2.0
"""Requirement on a thruster that is stuck open: shut off so soon after its failure [s]."""


def main() -> int:
    """Simulates the campaign and prints what its runs show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True)
    parser.add_argument("--scenario", default="final_approach")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--set", nargs="*", default=[], dest="changes")
    options = parser.parse_args()
    rpojax.prepare_process()
    file = rpojax.load(options.scenario, options.changes)
    campaign = rpojax.run_campaign(
        file,
        runs=options.runs,
        out=options.out,
        seed=options.seed,
    )
    outcomes, counts = np.unique(campaign.outcomes, return_counts=True)
    print(", ".join(f"{count} {outcome}" for outcome, count in zip(outcomes, counts, strict=True)))
    metrics = campaign.metrics
    print(f"{np.isfinite(metrics['final_lateral_error_m']).sum()} runs reach the last phase")
    for name in ARRIVAL:
        _print(name, metrics[name][np.isfinite(metrics[name])])
    print(f"relative NEES / 6: {np.mean(metrics['nees_relative_mean']) / 6.0:.2f}")
    return int("keep_out" in outcomes or not _isolates(campaign))


def _isolates(campaign: rpojax.Campaign) -> bool:
    """Prints outcomes by kind of fault and how soon stuck thrusters are shut off; whether all are soon enough."""
    if "isolation_delay_s" not in campaign.metrics:
        return True
    delay, shut = (campaign.metrics[name] for name in ("isolation_delay_s", "isolated_thrusters"))
    stuck = np.isfinite(delay)
    for name, chosen in (("stuck open", stuck), ("other", ~stuck)):
        completed = int(np.sum(campaign.outcomes[chosen] == "completed"))
        print(
            f"{name}: {int(chosen.sum())} runs, {completed} completed, {int(np.sum(shut[chosen]))} thrusters isolated"
        )
    if not stuck.any():
        return True
    least, p50, p99, most = np.percentile(delay[stuck], [0, 50, 99, 100])
    print(f"isolation_delay_s: least {least:.3f}, median {p50:.3f}, p99 {p99:.3f}, worst {most:.3f}")
    return bool(most <= LATEST_ISOLATION_S)


def _print(name: str, values: np.ndarray) -> None:
    p50, p99 = np.percentile(values, [50, 99])
    print(f"{name}: median {p50:.3f}, p99 {p99:.3f}, worst {values.max():.3f}")


if __name__ == "__main__":
    sys.exit(main())
