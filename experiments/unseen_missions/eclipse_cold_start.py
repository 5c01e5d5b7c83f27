"""Does a cold start in eclipse keep out? Prints a Markdown table; the exit status is 1 if a run is not kept out.

python experiments/unseen_missions/eclipse_cold_start.py --out out/eclipse_cold_start [--runs 256]

The hand-over is that of `inspection_cold`; orbit, light and forces are those of `inspection_eclipse`. It is in the
light, or anywhere in the orbit: also in the dark, where the servicer does not see the target for half an hour.
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", f"--xla_force_host_platform_device_count={os.cpu_count()}")

import numpy as np

import rpojax
from rpojax.simulation.outcomes.outcome_kinds import Outcome

COLD = ["navigation.initial_relative_position_sigma_m=5", "navigation.initial_relative_velocity_sigma_m_s=0.05"]
ANYWHERE = ["dispersions.orbit.true_anomaly_deg.low=0", "dispersions.orbit.true_anomaly_deg.high=360"]
SUN_OUT_OF_PLANE_DEG = (0.0, 15.0, 30.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=256)
    options = parser.parse_args()
    print("| Sun out of plane | hand-over | keep-out | lost or diverged | off station | least range |")
    print("|---|---|---|---|---|---|")
    entered = 0
    for elevation in SUN_OUT_OF_PLANE_DEG:
        for name, where in (("in the light", []), ("anywhere", ANYWHERE)):
            file = rpojax.load("inspection_eclipse", [*COLD, *where, f"orbit.raan_deg={elevation}"])
            out = options.out / f"{elevation:g}_{name.replace(' ', '_')}"
            result = rpojax.run_campaign(file, options.runs, out, histories=[])
            kinds = result.outcomes
            counts = {kind: int((kinds == kind).sum()) for kind in Outcome}
            entered += counts[Outcome.KEEP_OUT]
            print(
                f"| {elevation:g} deg | {name} | {counts[Outcome.KEEP_OUT]} of {options.runs} "
                f"| {counts[Outcome.LOST] + counts[Outcome.DIVERGED]} | {counts[Outcome.OFF_STATION]} "
                f"| {np.nanmin(result.metrics['min_range_m']):.1f} m |",
                flush=True,
            )
    return int(entered > 0)


if __name__ == "__main__":
    raise SystemExit(main())
