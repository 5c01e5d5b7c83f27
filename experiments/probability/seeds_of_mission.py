"""Estimates of one failure of a scenario over many seeds: their mean, their variation, and how many intervals hold it.

python experiments/probability/seeds_of_mission.py experiments/probability/keep_out_1e5.toml --budget 20000 --out FILE

The file has one line of JSON for each seed, and goes on where it ended; lines of another question are refused.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from mission_margins import mission_margins

from rpojax.analysis.reliability.rare_events import estimate_by_method
from rpojax.analysis.reliability.rare_events.latent_points import LimitStateCalls
from rpojax.scenario.scenario_digest import scenario_digest


def summary(found: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures of the estimates of all seeds; the mean of the others is what the interval of one should hold."""
    values = np.array([each["probability"] for each in found])
    others = (values.sum() - values) / (len(values) - 1)
    low, high = np.array([each["interval_95"] for each in found]).T
    return {
        "seeds": len(found),
        "mean": float(values.mean()),
        "standard_error": float(values.std(ddof=1) / len(values) ** 0.5),
        "variation_over_seeds": float(values.std(ddof=1) / values.mean()),
        "own_variation_median": float(np.median([each["coefficient_of_variation"] for each in found])),
        "hold_mean_of_others": int(((low <= others) & (others <= high)).sum()),
        "untrusted": sum(not each["trusted"] for each in found),
        "evaluations": max(each["evaluations"] for each in found),
        "methods": sorted({each["method"] for each in found}),
    }


def read_lines(path: Path, asked: dict[str, Any]) -> list[dict[str, Any]]:
    """Estimates of the seeds that are done; a line that was broken off is removed from the file."""
    text = path.read_text() if path.exists() else ""
    whole = text[: text.rfind("\n") + 1]
    found = [json.loads(line) for line in whole.splitlines()]
    for number, each in enumerate(found, start=1):
        other = {key: each.get(key) for key in asked if each.get(key) != asked[key]}
        if other or each["seed"] != number:
            raise SystemExit(f"{path} line {number}: found seed {each['seed']} {other}, expected {number} of {asked}")
    if whole != text:
        path.write_text(whole)
    return found


def main() -> None:
    """Estimates with one compiled program and a generator of its own for each seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario")
    parser.add_argument("--outcome", default="keep_out")
    parser.add_argument("--budget", type=int, default=10_000)
    parser.add_argument("--method", default="auto")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    if options.seeds < 2:
        parser.error(f"--seeds: found {options.seeds}, expected at least 2, for a variation over them")
    # Keys of the noise are from the generator of each seed, so that the runs of two seeds have none in common.
    margins = mission_margins(options.scenario, options.outcome, 1)
    asked = {
        "scenario_hash": scenario_digest(margins.space.file),
        "failure": margins.failure.words,
        "budget": options.budget,
        "asked_method": options.method,
    }
    found = read_lines(options.out, asked)
    with options.out.open("a") as stream:
        for seed in range(len(found) + 1, options.seeds + 1):
            calls = LimitStateCalls(margins, margins.latent, options.budget)
            estimate = estimate_by_method.estimate(calls, np.random.default_rng(seed), options.method).to_dict()
            del estimate["design_points"]
            found.append({"seed": seed, **asked, **estimate})
            print(json.dumps(found[-1]), file=stream, flush=True)
    print(json.dumps(summary(found[: options.seeds])))


if __name__ == "__main__":
    main()
