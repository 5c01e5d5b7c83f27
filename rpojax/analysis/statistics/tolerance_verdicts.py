"""Judges requirements from independent runs: verified at a stated consumer's risk, refuted at the same, or neither.

The consumer's risk is the probability of accepting a design that meets the requirement in just less than the share of
runs that it asks for (Hanson and Beard, NASA/TP-2010-216447).
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.stats import beta

from rpojax.analysis.statistics.order_statistics import allowed_failures, consumer_risk_reached, runs_for_bound
from rpojax.scenario.schema import RequirementSection

_MOST_IDS = 20


class Verdict(StrEnum):
    """What runs say of a requirement."""

    VERIFIED = "verified"
    NOT_VERIFIED = "not verified"
    MORE_RUNS = "needs more runs"
    NOT_INDEPENDENT = "not independent: no verdict"
    UNFINISHED = "unfinished: no verdict"


@dataclass(frozen=True)
class RequirementEvaluation:
    """A requirement and what the runs of a campaign say of it.

    Where runs are not independent, or some are missing, what rests on independence is None: runs that did not come to
    their end may well be the bad ones. Values are in the metric's unit.

    Attributes:
        requirement: that was judged
        verdict: of the runs
        more_runs: fewest further runs, none of them in violation, that would verify; None with another verdict
        runs: that were judged
        violations: runs beyond the limit, failed, or without the metric
        allowed: most violations with which so many runs verify; None if too few
        rank: of the run that must keep the limit, 1 is the best; None if too few runs
        order_statistic: value of that run; None if too few runs, or if it failed or has no metric
        margin: from that value to the limit, positive inside; None without it
        without_value: runs that failed or have not the metric
        worst: worst value of the others; None without any
        success: share of runs without violation; None without runs
        success_interval: exact bounds of the probability of success, each of them wrong with the consumer's risk
        risk_reached: smallest consumer's risk at which the runs would verify
        violating_ids: numbers of at most 20 violating runs, those without a value first, then the worst
    """

    requirement: RequirementSection
    verdict: Verdict
    more_runs: int | None
    runs: int
    violations: int
    allowed: int | None
    rank: int | None
    order_statistic: float | None
    margin: float | None
    without_value: int
    worst: float | None
    success_fraction: float | None
    success_interval: tuple[float, float] | None
    risk_reached: float | None
    violating_ids: tuple[int, ...]

    @property
    def text(self) -> str:
        """The verdict in words, with the number of runs that it lacks."""
        return self.verdict if self.more_runs is None else f"needs {self.more_runs} more runs"


def violates(requirement: RequirementSection, values: np.ndarray, failed: np.ndarray) -> np.ndarray:
    """Runs (n,) that violate a requirement: beyond the limit by the metric's `values` (n,), without any, or failed."""
    return _badness(requirement, values, failed) > _sign(requirement) * requirement.limit


def evaluate_requirement(
    requirement: RequirementSection,
    values: np.ndarray,
    failed: np.ndarray,
    run_ids: np.ndarray,
    independent: bool,
    missing: int = 0,
) -> RequirementEvaluation:
    """Judges a requirement by the metric's `values` (n,), which runs `failed` (n,), and their `run_ids` (n,).

    With runs still `missing` of those that were asked for there is no verdict.
    """
    badness = _badness(requirement, values, failed)
    violating = badness > _sign(requirement) * requirement.limit
    count, runs = int(violating.sum()), len(values)
    told = independent and not missing
    allowed = allowed_failures(runs, requirement.probability, requirement.consumer_risk) if told else None
    rank = None if allowed is None else runs - allowed
    at_rank = None if rank is None else _value(requirement, np.sort(badness)[rank - 1])
    verdict, interval = Verdict.UNFINISHED if independent else Verdict.NOT_INDEPENDENT, None
    if told:
        interval = success_interval(count, runs, requirement.consumer_risk)
        verdict = _verdict(requirement, count, allowed, interval[1])
    return RequirementEvaluation(
        requirement=requirement,
        verdict=verdict,
        more_runs=_more_runs(requirement, count, runs) if verdict is Verdict.MORE_RUNS else None,
        runs=runs,
        violations=count,
        allowed=allowed,
        rank=rank,
        order_statistic=at_rank,
        margin=None if at_rank is None else _sign(requirement) * (requirement.limit - at_rank),
        without_value=int(np.sum(np.isinf(badness))),
        worst=_value(requirement, np.max(badness[np.isfinite(badness)], initial=-np.inf)),
        success_fraction=1.0 - count / runs if runs else None,
        success_interval=interval,
        risk_reached=consumer_risk_reached(count, runs, requirement.probability) if told else None,
        violating_ids=_worst_first(badness, violating, run_ids),
    )


def success_interval(violations: int, runs: int, risk: float) -> tuple[float, float]:
    """Exact bounds of the probability of success, each one-sided with that `risk` (Clopper and Pearson, 1934).

    The lower one reaches a requirement's probability just where its runs verify it.
    """
    low = 0.0 if violations == runs else float(beta.ppf(risk, runs - violations, violations + 1))
    high = 1.0 if violations == 0 else float(beta.ppf(1.0 - risk, runs - violations + 1, violations))
    return low, high


def _verdict(requirement: RequirementSection, count: int, allowed: int | None, highest: float) -> Verdict:
    if allowed is not None and count <= allowed:
        return Verdict.VERIFIED
    return Verdict.NOT_VERIFIED if highest < requirement.probability else Verdict.MORE_RUNS


def _more_runs(requirement: RequirementSection, count: int, runs: int) -> int:
    """Fewest further runs, none of them in violation, that verify a requirement with `count` violations so far."""
    return max(1, runs_for_bound(requirement.probability, 1.0 - requirement.consumer_risk, count + 1) - runs)


def _sign(requirement: RequirementSection) -> float:
    return 1.0 if requirement.bound == "at most" else -1.0


def _badness(requirement: RequirementSection, values: np.ndarray, failed: np.ndarray) -> np.ndarray:
    """Values turned so that more is worse; infinite for runs that failed or have none."""
    return np.where(failed | ~np.isfinite(values), np.inf, _sign(requirement) * values)


def _value(requirement: RequirementSection, badness: float) -> float | None:
    return _sign(requirement) * float(badness) if np.isfinite(badness) else None


def _worst_first(badness: np.ndarray, violating: np.ndarray, run_ids: np.ndarray) -> tuple[int, ...]:
    order = np.lexsort((run_ids, -badness))
    return tuple(run_ids[order[violating[order]]][:_MOST_IDS].tolist())
