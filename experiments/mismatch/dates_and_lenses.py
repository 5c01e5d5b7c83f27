"""Keep-out entries over the dates, node angles and lenses of a year, handed over in light or in the dark.

python experiments/mismatch/dates_and_lenses.py --out DIR [--runs 50] [--seed 11]

`--runs` is the number of runs of each date and lens; there are eight and five. The exit status is 1 if a run enters the
keep-out sphere.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unseen_missions"))

import mission_campaigns
from mission_campaigns import Variant

from rpojax.simulation.outcomes.outcome_kinds import Outcome

DATES = [f"2026-{month:02d}-{day:02d}T14:46:00" for month in (3, 6, 9, 12) for day in (1, 20)]
LENSES_DEG = (4.0, 7.0, 10.0, 16.0, 25.0)


def anywhere(rng: np.random.Generator, runs: int) -> np.ndarray:
    """An angle of a full turn [deg]."""
    return rng.uniform(0.0, 360.0, runs)


def main() -> int:
    """Simulates the dates and lenses, and prints a row for each lens."""
    options = mission_campaigns.parser(__doc__, runs=50).parse_args()
    print(f"{options.runs} runs of each date and lens, seed {options.seed}.\n")
    mission_campaigns.header("lens", "keep-out", "by date", "outcomes")
    entered = 0
    for lens_deg in LENSES_DEG:
        # The turns of a search are as far apart, by the field of view, as those of `inspection`.
        optics = (f"camera.field_of_view_deg={lens_deg}", f"pointing.search_pitch_deg={0.65 * lens_deg:g}")
        variants = {date: Variant({"orbit.raan_deg": anywhere}, date, optics) for date in DATES}
        found = [campaign.outcomes[rows] for _, campaign, rows in
                 mission_campaigns.variant_campaigns(variants, options, 0)]  # fmt: skip
        inside = [int((outcomes == Outcome.KEEP_OUT).sum()) for outcomes in found]
        entered += sum(inside)
        mission_campaigns.row(
            f"{lens_deg} deg",
            str(sum(inside)),
            ", ".join(f"{date[:10]}: {count}" for date, count in zip(DATES, inside, strict=True) if count) or "-",
            mission_campaigns.outcome_counts(np.concatenate(found)),
        )
    print(f"\n{entered} of {len(DATES) * len(LENSES_DEG) * options.runs} runs entered the keep-out sphere.")
    return int(entered > 0)


if __name__ == "__main__":
    sys.exit(main())
