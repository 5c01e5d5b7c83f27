"""Risks and numbers of runs of sequential campaigns, by simulated violations through the bounds that campaigns use.

python experiments/evidence/sequential_risks.py
"""

import json
import math

import numpy as np
from scipy.stats import binomtest

from rpojax.campaign.group_sequential_bounds import decide, fixed_runs, look_bounds

CAMPAIGNS, CONFIDENCE = 10_000, 0.99
DEMANDS = ((0.99, 0.1), (0.95, 0.1), (0.9, 0.05), (0.999, 0.1))


def looks_of(runs: int, block: int) -> tuple[int, ...]:
    """Looks of a campaign of at most `runs` runs, as `sequential_looks.with_plan` makes them for blocks of a size."""
    step = math.ceil(math.ceil(runs / 24) / block) * block
    return (*range(step, runs, step), runs)


def simulated(probability: float, risk: float, factor: float, chance_counts: bool, seed: int) -> dict[str, float]:
    """Shares of campaigns that verify and refute, and the mean number of runs over that of the fixed plan.

    `factor` is the rate of violations over the rate that the requirement allows. With `chance_counts` a run counts
    with probability one half, as for a requirement on some of the runs, and the fixed plan has twice the runs.
    """
    share = 0.5 if chance_counts else 1.0
    fixed = fixed_runs(probability, risk) / share
    looks = looks_of(round(1.5 * fixed), 8)
    fractions = tuple(look / looks[-1] for look in looks)
    rng = np.random.default_rng(seed)
    steps = np.diff((0, *looks))
    counted = rng.binomial(steps, share, size=(CAMPAIGNS, len(looks)))
    violations = np.cumsum(rng.binomial(counted, factor * (1.0 - probability)), axis=1).tolist()
    runs_that_count = [tuple(row) for row in np.cumsum(counted, axis=1).tolist()]
    found = [
        decide(look_bounds(runs, fractions, probability, risk), path)
        for runs, path in zip(runs_that_count, violations, strict=True)
    ]
    ended = [looks[-1] if each is None else looks[each.look - 1] for each in found]
    return {
        "verified": sum(each is not None and each.verified for each in found),
        "refuted": sum(each is not None and not each.verified for each in found),
        "runs_over_fixed": float(np.mean(ended) / fixed),
    }


def main() -> None:
    """Prints a line for each demand: at the limit the tests of both risks, elsewhere the number of runs."""
    for number, (probability, risk) in enumerate(DEMANDS):
        for chance_counts in (False, True)[: 1 if number else 2]:
            at_limit = simulated(probability, risk, 1.0, chance_counts, number)
            p_values = {
                side: binomtest(int(at_limit[side]), CAMPAIGNS, risk, alternative="greater").pvalue
                for side in ("verified", "refuted")
            }
            line = {
                "probability": probability,
                "risk": risk,
                "counts_by_chance": chance_counts,
                "fixed_runs": fixed_runs(probability, risk),
                "verified_at_limit": at_limit["verified"] / CAMPAIGNS,
                "refuted_at_limit": at_limit["refuted"] / CAMPAIGNS,
                "risks_kept": all(p > 1.0 - CONFIDENCE for p in p_values.values()),
            }
            for factor in (0.0, 0.05, 0.1, 0.25, 3.0) if not chance_counts else ():
                found = simulated(probability, risk, factor, chance_counts, 100 + number)
                line[f"at {factor:g} of the limit"] = [
                    found["verified"] / CAMPAIGNS,
                    found["refuted"] / CAMPAIGNS,
                    round(found["runs_over_fixed"], 3),
                ]
            print(json.dumps(line))


if __name__ == "__main__":
    main()
