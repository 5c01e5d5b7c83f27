"""What a delay of measurements costs: known to the filter, and ignored by it, at a quiet hold and while turning.

python experiments/close_range/delays.py --out DIR [--runs 64] [--seed 1] [--delay 0.5]

`inspection` holds a station with a frame a second; `fast_fly_around` circles the target so that the camera turns by
1 deg/s. Camera and range finder are late by the same time.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

import rpojax

MISSIONS = {
    "inspection": ("inspection", ("camera",)),
    "fast_fly_around": (str(Path(__file__).with_name("fast_fly_around.toml")), ("camera", "range_finder")),
}


def main() -> int:
    """Simulates each mission without delay, with a known one, and with one that the filter ignores."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True)
    parser.add_argument("--runs", type=int, default=64)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--delay", type=float, default=0.5)
    options = parser.parse_args()
    rpojax.prepare_process()
    for name, (scenario, sensors) in MISSIONS.items():
        late = [f"{sensor}.delay_s={options.delay}" for sensor in sensors]
        cases = {"none": [], "known": late, "ignored": [*late, "navigation.delays=ignored"]}
        for case, changes in cases.items():
            file = rpojax.load(scenario, changes)
            out = Path(options.out) / f"{name}_{case}"
            campaign = rpojax.run_campaign(file, runs=options.runs, out=str(out), seed=options.seed)
            _print(f"{name}, {case}", campaign)
    return 0


def _print(case: str, campaign: "rpojax.Campaign") -> None:
    metrics, completed = campaign.metrics, np.mean(campaign.outcomes == "completed")
    error, nees = metrics["nav_relative_position_error_rms_m"], metrics["nees_relative_mean"] / 6.0
    print(
        f"{case}: relative error median {np.median(error):.3f} m, mean {error.mean():.3f} m; NEES / 6 mean"
        f" {nees.mean():.2f}, median {np.median(nees):.2f}; {100.0 * completed:.0f} % completed",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
