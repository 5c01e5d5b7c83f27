"""Attitude error and NEES of filters on the same unseen runs, the packaged one first.

    python -m experiments.pose.tuned_filter experiments/pose/spoilt_filter.toml TUNED.toml --out OUT [--runs 200]

The exit status is 1 where the last of them is worse than the packaged one: an attitude error at 95 % of the runs that
is more than 10 % larger, or a mean NEES that is further from 6, in its logarithm, by more than 10 %.
"""

import argparse
from pathlib import Path

import numpy as np

import rpojax

PACKAGED = "pose_inspection"
MARGIN = 0.1


def figures(scenario: str, runs: int, seed: int, out: Path) -> tuple[float, float]:
    """Attitude error at 95 % of the runs [deg], and mean NEES over 6; prints them and others."""
    file = rpojax.load(scenario)
    made = rpojax.run_campaign(file, runs, out / file.name, seed, histories=[], report=False, force=True)
    error, rate, nees = (
        np.asarray(made.metrics[name])
        for name in ("target_attitude_error_deg", "target_rate_error_deg_s", "nees_pose_mean")
    )
    found = float(np.nanpercentile(error, 95.0)), float(np.nanmean(nees)) / 6.0
    print(
        f"{scenario}: attitude error {np.nanmedian(error):.4f} deg in the median, {found[0]:.4f} at 95 %, rate "
        f"{np.nanpercentile(rate, 95.0):.2e} deg/s at 95 %, NEES over 6 {found[1]:.3f} in the mean, "
        f"{np.isnan(error).sum()} runs without a value"
    )
    return found


def main() -> int:
    """Prints a line of each scenario."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenarios", nargs="+")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    rpojax.prepare_process()
    of_all = [figures(each, asked.runs, asked.seed, asked.out) for each in (PACKAGED, *asked.scenarios)]
    (error, nees), (tuned_error, tuned_nees) = of_all[0], of_all[-1]
    print(f"over the packaged ones: attitude error {tuned_error / error:.3f}, NEES {tuned_nees / nees:.3f}")
    consistent = abs(np.log(tuned_nees)) <= abs(np.log(nees)) + np.log1p(MARGIN)
    return int(tuned_error > (1.0 + MARGIN) * error or not consistent)


if __name__ == "__main__":
    raise SystemExit(main())
