"""The last hundred metres with twelve thrusters: errors at 3 m, closing speed, and consistency of the filter.

python experiments/close_range/final_approach.py --out DIR [--scenario final_approach] [--runs 1000] [--seed 0]
    [--set KEY=VALUE ...]

The exit status is 1 if a run enters the keep-out sphere.
"""

import argparse
import sys

import numpy as np

import rpojax
from rpojax.campaign.options.history_retention import Retention

CHANNELS = ["rho_H", "rho_desired_H", "range_m", "phase", "nees_relative"]
SLOW_BELOW_M = 20.0
"""Range below which the closing speed counts."""
ARRIVED_FOR_S = 60.0
"""Time in the last phase after which the errors of arrival are read: a mean over the next ten seconds."""


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
        histories=Retention("all", channels=tuple(CHANNELS)),
    )
    outcomes, counts = np.unique(campaign.outcomes, return_counts=True)
    print(", ".join(f"{count} {outcome}" for outcome, count in zip(outcomes, counts, strict=True)))
    last = len(file.phases) - 1
    rows = [row for run in campaign.history_ids if (row := _of_run(campaign.history(run), last)) is not None]
    lateral, along, speed, consistency = (np.array(each) for each in zip(*rows, strict=True))
    print(f"{len(rows)} runs reach the last phase")
    _print("lateral error [m]", lateral)
    _print("range error [m]", np.abs(along))
    _print("closing speed below 20 m [m/s]", speed)
    print(f"relative NEES / 6: {np.mean(consistency) / 6.0:.2f}")
    return int("keep_out" in outcomes)


def _of_run(history: dict[str, np.ndarray], last: int) -> tuple[float, float, float, float] | None:
    """Lateral and range error at the end, fastest approach and mean NEES of a run; None if it never arrived."""
    phase, reach = history["phase"], history["range_m"]
    inside = np.flatnonzero(phase == last)
    if not inside.size:
        return None
    ticks = slice(inside[0] + int(ARRIVED_FOR_S), inside[0] + int(ARRIVED_FOR_S) + 10)
    place, wanted = history["rho_H"][ticks].mean(axis=0), history["rho_desired_H"][ticks].mean(axis=0)
    if not np.isfinite(place).all():
        return None
    axis = wanted / np.linalg.norm(wanted)
    lateral = np.linalg.norm(place - (place @ axis) * axis)
    # Over ten seconds, as the derivative of a range.
    approach = (reach[:-10] - reach[10:]) / 10.0
    close = (reach[10:] < SLOW_BELOW_M) & (phase[10:] <= last)
    consistency = np.nanmean(history["nees_relative"][phase <= last])
    return lateral, np.linalg.norm(place) - np.linalg.norm(wanted), approach[close].max(), consistency


def _print(name: str, values: np.ndarray) -> None:
    p50, p99 = np.percentile(values, [50, 99])
    print(f"{name}: median {p50:.3f}, p99 {p99:.3f}, worst {values.max():.3f}")


if __name__ == "__main__":
    sys.exit(main())
