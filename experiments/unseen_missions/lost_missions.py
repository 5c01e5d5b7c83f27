"""Are missions that cannot succeed reported as such? Prints a Markdown table of outcomes and of warnings before.

python experiments/unseen_missions/lost_missions.py --out out/lost_missions [--runs 256]

The exit status is 1 if a run counts as completed that ends more than 10 m from its station.
"""

import mission_campaigns
import numpy as np
from mission_campaigns import Case

import rpojax
from rpojax.scenario.warnings import mission_warnings
from rpojax.simulation.outcomes.outcome_kinds import Outcome

CASES = (
    Case("30 % outliers, 50 % misses", "inspection", ["camera.outlier_probability=0.3", "camera.miss_probability=0.5"]),
    Case("servicer of 300 kg", "inspection", ["servicer.mass_kg=300"]),
    Case("start at 500 m", "inspection", ["initial.relative_position_m=[0.0,-500.0,0.0]"]),
    Case("camera of 0.2 Hz", "inspection", ["rates.camera_hz=0.2"]),
)
KINDS = (Outcome.COMPLETED, Outcome.KEEP_OUT, Outcome.LOST, Outcome.DIVERGED, Outcome.OFF_STATION)


def main() -> int:
    options = mission_campaigns.parser(__doc__, runs=256).parse_args()
    mission_campaigns.header("mission", *(str(kind) for kind in KINDS), "farthest completed run", "warnings before")
    astray = 0
    for case, result in mission_campaigns.campaigns(CASES, options):
        # The last sample of a trace is ten seconds before the end, where a run is judged.
        before, last = result.traces["formation_error_m"][:, -2:].T
        distance = 2.0 * last - before
        completed = result.outcomes == Outcome.COMPLETED
        farthest = float(np.max(distance[completed], initial=0.0))
        astray += int((distance[completed] > 10.0).sum())
        warnings = mission_warnings.mission_warnings(rpojax.load(case.scenario, list(case.overrides)))
        counts = [str(int((result.outcomes == kind).sum())) for kind in KINDS]
        mission_campaigns.row(case.name, *counts, f"{farthest:.1f} m", "; ".join(warnings) or "-")
    return int(astray > 0)


if __name__ == "__main__":
    raise SystemExit(main())
