"""Does a cold start in eclipse keep out? Prints a Markdown table; the exit status is 1 if a run is not kept out.

python experiments/unseen_missions/eclipse_cold_start.py --out out/eclipse_cold_start [--runs 256]

The hand-over is that of `inspection_cold`; orbit, light and forces are those of `inspection_eclipse`. It is in the
light, or anywhere in the orbit: also in the dark, where the servicer does not see the target for half an hour.
"""

import mission_campaigns
import numpy as np
from mission_campaigns import Case

from rpojax.simulation.outcomes.outcome_kinds import Outcome

COLD = ["navigation.initial_relative_position_sigma_m=5", "navigation.initial_relative_velocity_sigma_m_s=0.05"]
ANYWHERE = ["dispersions.orbit.true_anomaly_deg.low=0", "dispersions.orbit.true_anomaly_deg.high=360"]
SUN_OUT_OF_PLANE_DEG = (0.0, 15.0, 30.0)


def main() -> int:
    options = mission_campaigns.parser(__doc__, runs=256).parse_args()
    cases = [
        Case(f"{elevation:g} deg, {name}", "inspection_eclipse", [*COLD, *where, f"orbit.raan_deg={elevation}"])
        for name, where in (("anywhere", ANYWHERE), ("in the light", []))
        for elevation in SUN_OUT_OF_PLANE_DEG
    ]
    mission_campaigns.header(
        "Sun out of plane, hand-over", "keep-out", "completed", "lost", "diverged", "off station", "least range"
    )
    entered = 0
    for case, result in mission_campaigns.campaigns(cases, options):
        counts = {kind: int((result.outcomes == kind).sum()) for kind in Outcome}
        entered += counts[Outcome.KEEP_OUT]
        kinds = (Outcome.COMPLETED, Outcome.LOST, Outcome.DIVERGED, Outcome.OFF_STATION)
        mission_campaigns.row(
            case.name,
            f"{counts[Outcome.KEEP_OUT]} of {options.runs}",
            *(str(counts[kind]) for kind in kinds),
            f"{np.nanmin(result.metrics['min_range_m']):.1f} m",
        )
    return int(entered > 0)


if __name__ == "__main__":
    raise SystemExit(main())
