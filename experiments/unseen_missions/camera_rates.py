"""Do slow and fast cameras behave as one of 1 Hz? Prints one Markdown table; the exit status is 1 if a run is lost.

python experiments/unseen_missions/camera_rates.py --out out/camera_rates [--runs 64]
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", f"--xla_force_host_platform_device_count={os.cpu_count()}")

import numpy as np

import rpojax
from rpojax.campaign.storage.campaign_folder import Campaign

RATES_HZ = (0.2, 0.5, 1.0, 2.0, 5.0)
OFF_STATION_M = 10.0
"""A run that ends farther than this from its station is lost [m]."""
JUDGED_FROM_S = 5000.0
"""The least distance from the station is taken from here to the end, so that a passing error does not count [s]."""


def lost_runs(result: Campaign) -> int:
    """Number of runs that failed or ended away from their station."""
    station_H = np.asarray(result.file.formation.desired_position_m)
    first = int(JUDGED_FROM_S * result.file.rates.camera_hz)
    distances = [
        np.linalg.norm(result.history(run)["rho_H"][first:] - station_H, axis=1).min() for run in result.history_ids
    ]
    return int((~(np.array(distances) <= OFF_STATION_M)).sum())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=64)
    options = parser.parse_args()
    print(
        "| camera | lost runs | formation error, median | p95 | relative position error, median | NEES/6 | coverage |"
    )
    print("|---|---|---|---|---|---|---|")
    lost = 0
    for rate in RATES_HZ:
        file = rpojax.load("inspection", [f"rates.camera_hz={rate}"])
        out = options.out / f"{rate:g}_hz"
        result = rpojax.run_campaign(file, options.runs, out, histories=range(options.runs))
        metrics, here = result.metrics, lost_runs(result)
        lost += here
        formation = metrics["formation_error_rms_m"]
        print(
            f"| {rate:g} Hz | {here} of {options.runs} | {np.nanmedian(formation):.3f} m "
            f"| {np.nanpercentile(formation, 95):.2f} m "
            f"| {np.nanmedian(metrics['nav_relative_position_error_rms_m']):.3f} m "
            f"| {np.nanmean(metrics['nees_relative_mean']) / 6.0:.2f} "
            f"| {100.0 * np.nanmean(metrics['sigma3_coverage']):.1f} % |",
            flush=True,
        )
    return int(lost > 0)


if __name__ == "__main__":
    raise SystemExit(main())
