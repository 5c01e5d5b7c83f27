"""False alarms and missed detections of the health tests on board; prints one Markdown table.

python experiments/unseen_missions/navigation_health.py --out out/navigation_health [--runs 64]

The exit status is 1 if a packaged mission has false alarms for more than a hundredth of its time, or if a run with a
wrong size enters the keep-out sphere.
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", f"--xla_force_host_platform_device_count={os.cpu_count()}")

import numpy as np

import rpojax
from rpojax.simulation.outcomes.outcome_kinds import Outcome

PACKAGED = {name: (name, []) for name in ("inspection", "inspection_cold", "inspection_eclipse")}
WRONG_SIZE = {
    f"size believed {factor:g} times": ("inspection", [f"navigation.target_size_m={1.063 * factor}"])
    for factor in (1.0 / 3.0, 1.0 / 1.5, 1.5, 3.0)
}
HOSTILE = {
    "GPS noise tenfold": ("inspection", ["gps.noise_m=20"]),
    "30 % outliers, 50 % misses": ("inspection", ["camera.outlier_probability=0.3", "camera.miss_probability=0.5"]),
}
MOST_FALSE_ALARMS = 0.01


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=64)
    options = parser.parse_args()
    print("| mission | confident | false alarms | missed | keep-out | formation error, median |")
    print("|---|---|---|---|---|---|")
    failed = False
    for name, (scenario, overrides) in (PACKAGED | WRONG_SIZE | HOSTILE).items():
        out = options.out / name.replace(" ", "_").replace("%", "percent").replace(",", "")
        result = rpojax.run_campaign(rpojax.load(scenario, overrides), options.runs, out, histories=[])
        metrics, entered = result.metrics, int((result.outcomes == Outcome.KEEP_OUT).sum())
        false_alarms = float(np.nanmean(metrics["health_false_alarm_fraction"]))
        missed = metrics["health_missed_fraction"]
        missed_text = f"{100.0 * np.nanmean(missed):.0f} %" if np.isfinite(missed).any() else "-"
        failed |= name in PACKAGED and false_alarms > MOST_FALSE_ALARMS
        failed |= name in WRONG_SIZE and entered > 0
        print(
            f"| {name} | {100.0 * np.nanmean(metrics['confident_fraction']):.1f} % | {100.0 * false_alarms:.2f} % "
            f"| {missed_text} | {entered} of {options.runs} | {np.nanmedian(metrics['formation_error_rms_m']):.2f} m |",
            flush=True,
        )
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
