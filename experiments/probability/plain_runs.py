"""Plain sampling of a failure of a scenario: how many of so many runs fail, in a file that goes on where it ended."""

import argparse
import json
from pathlib import Path

import numpy as np
from mission_margins import mission_margins

from rpojax.analysis.statistics.intervals import clopper_pearson_interval

BATCH = 10_240


def main() -> None:
    """Simulates runs with all their noise and counts failures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--outcome", default="keep_out")
    parser.add_argument("--runs", type=int, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    margins = mission_margins(options.scenario, options.outcome, options.seed)
    found = json.loads(options.out.read_text()) if options.out.exists() else {"runs": 0, "failures": 0}
    while found["runs"] < options.runs:
        count = min(BATCH, options.runs - found["runs"])
        # A generator for each batch, so that a run that was broken off goes on with the same numbers.
        rng = np.random.default_rng([options.seed, found["runs"]])
        failed = margins(margins.latent.sample(rng, count)) <= 0.0
        found = {"runs": found["runs"] + count, "failures": found["failures"] + int(failed.sum())}
        found["probability"] = found["failures"] / found["runs"]
        found["interval_95"] = clopper_pearson_interval(found["failures"], found["runs"])
        options.out.write_text(json.dumps({"scenario": options.scenario, "seed": options.seed, **found}) + "\n")
    print(options.out.read_text().strip())


if __name__ == "__main__":
    main()
