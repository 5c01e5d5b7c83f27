"""Do slow and fast cameras behave as one of 1 Hz? Prints one Markdown table; the exit status is 1 if a run is lost.

python experiments/unseen_missions/camera_rates.py --out out/camera_rates [--runs 64]
"""

import math

import mission_campaigns
import numpy as np
from mission_campaigns import Case, mean, percent

from rpojax.campaign.storage.campaign_folder import Campaign

RATES_HZ = (0.2, 0.5, 1.0, 2.0, 5.0)
OFF_STATION_M = 10.0
"""A run that ends farther than this from its station is lost [m]."""
JUDGED_FROM_S = 5000.0
"""The least distance from the station is taken from here to the end, so that a passing error does not count [s]."""


def plant_hz(camera_hz: float) -> float:
    """Least multiple of the camera's rate that is at least the packaged rate of the plant, of 5 Hz."""
    return camera_hz * math.ceil(5.0 / camera_hz)


def lost_runs(result: Campaign) -> int:
    """Number of runs that failed or ended away from their station."""
    station_H = np.asarray(result.file.formation.desired_position_m)
    first = int(JUDGED_FROM_S * result.file.rates.camera_hz)
    distances = [
        np.linalg.norm(result.history(run)["rho_H"][first:] - station_H, axis=1).min() for run in result.history_ids
    ]
    return int((~(np.array(distances) <= OFF_STATION_M)).sum())


def main() -> int:
    options = mission_campaigns.parser(__doc__, runs=64).parse_args()
    cases = [
        Case(f"{rate:g} Hz", "inspection", [f"rates.camera_hz={rate}", f"rates.plant_hz={plant_hz(rate)}"])
        for rate in RATES_HZ
    ]
    mission_campaigns.header(
        "camera",
        "lost runs",
        "formation error, median",
        "p95",
        "relative position error, median",
        "NEES/6",
        "coverage",
        "confident",
    )
    lost = 0
    for case, result in mission_campaigns.campaigns(cases, options, histories=options.runs):
        metrics, here = result.metrics, lost_runs(result)
        lost += here
        formation = metrics["formation_error_rms_m"]
        mission_campaigns.row(
            case.name,
            f"{here} of {options.runs}",
            f"{np.nanmedian(formation):.3f} m",
            f"{np.nanpercentile(formation, 95):.2f} m",
            f"{np.nanmedian(metrics['nav_relative_position_error_rms_m']):.3f} m",
            f"{mean(metrics['nees_relative_mean']) / 6.0:.2f}",
            percent(mean(metrics["sigma3_coverage"])),
            percent(mean(metrics["confident_fraction"])),
        )
    return int(lost > 0)


if __name__ == "__main__":
    raise SystemExit(main())
