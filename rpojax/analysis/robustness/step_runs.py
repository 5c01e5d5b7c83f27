"""Runs of steps: the same runs with one quantity moved, and what they break."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from rpojax.analysis.robustness.assigned_runs import AssignedRuns, BatchCallback
from rpojax.analysis.robustness.believed_quantities import Quantity
from rpojax.analysis.robustness.margin_search import StepVerdict
from rpojax.analysis.statistics.intervals import success_bounds
from rpojax.scenario.schema import RequirementSection, ScenarioFile
from rpojax.simulation.outcomes.outcome_kinds import Outcome
from rpojax.simulation.outcomes.requirement_violations import counts, required_values, violates

COMPLETED: Final = "completed"
"""Name under which runs that fail are counted, beside the requirements."""
DEFAULT_PROBABILITY, DEFAULT_RISK = 0.99, 0.1
"""Share of runs that must not fail, and its risk, in a scenario without requirements."""
_STEPS_AT_ONCE: Final = 4
"""Steps that a batch holds: a round of few sides wastes little."""
Step = tuple[Quantity, float]
"""A quantity and its offset, in its unit."""


class StepRuns(AssignedRuns):
    """Runs 0 to `runs` - 1 of a seed, with quantities moved."""

    def __init__(
        self, file: ScenarioFile, quantities: Sequence[Quantity], runs: int, seed: int, free_drifts: bool
    ) -> None:
        keys = [key for each in quantities for key in each.keys]
        super().__init__(file, keys, runs, seed, free_drifts, _STEPS_AT_ONCE)

    def simulate(self, steps: Sequence[Step], on_batch: BatchCallback) -> list[dict[str, np.ndarray]]:
        """Metrics and `outcomes` (runs,) by name of each step; `on_batch` is called during it."""
        return self.simulate_changes([each.moved(self.values, offset, self.ids) for each, offset in steps], on_batch)


def requirement_names(requirements: Sequence[RequirementSection]) -> list[str]:
    """Name of each requirement: its metric, with the limit where several are on one metric."""
    names = [each.metric_name for each in requirements]
    return [
        f"{name} {each.bound} {each.limit:g}" if names.count(name) > 1 else name
        for name, each in zip(names, requirements, strict=True)
    ]


def judge_step(
    requirements: Sequence[RequirementSection], found: Mapping[str, np.ndarray], judged: Sequence[str] | None = None
) -> StepVerdict:
    """Verdict on the runs of a step, on what is named in `judged`, by default on all whose metrics there are.

    The share of runs that fail must not exceed what the strictest requirement allows to violate it.
    """
    probability = max((each.probability for each in requirements), default=DEFAULT_PROBABILITY)
    risk = min((each.consumer_risk for each in requirements), default=DEFAULT_RISK)
    failed = np.isin(found["outcomes"], [str(kind) for kind in Outcome if kind.is_failure])
    rows = {COMPLETED: (int(failed.sum()), len(failed), probability, risk)}
    for name, each in zip(requirement_names(requirements), requirements, strict=True):
        if each.metric_name in found:
            counted = counts(each, found, found["outcomes"])
            broken = violates(each, required_values(each, found)) & counted
            rows[name] = (int(broken.sum()), int(counted.sum()), each.probability, each.consumer_risk)
    rows = {name: row for name, row in rows.items() if judged is None or name in judged}
    bounds = {name: success_bounds(number, total, risk) for name, (number, total, _, risk) in rows.items() if total}
    excess = {name: number / total / (1.0 - share) for name, (number, total, share, _) in rows.items() if total}
    # Whole numbers of violations that meet the probability exactly are allowed.
    broken = [name for name in excess if excess[name] > 1.0 + 1e-9]
    return StepVerdict(
        broken=tuple(sorted(broken, key=lambda name: -excess[name])),
        surely_broken=any(bounds[name][1] < rows[name][2] for name in bounds),
        surely_holds=all(bounds[name][0] >= rows[name][2] for name in bounds),
        record=_record(rows, found["outcomes"]),
    )


def _record(rows: Mapping[str, tuple[Any, ...]], outcomes: np.ndarray) -> dict[str, Any]:
    kinds, numbers = np.unique(outcomes, return_counts=True)
    return {
        "violations": {name: row[0] for name, row in rows.items()},
        "outcomes": dict(zip(kinds.tolist(), numbers.tolist(), strict=True)),
    }
