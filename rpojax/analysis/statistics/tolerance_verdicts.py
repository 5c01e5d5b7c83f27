"""Verdicts on requirements from independent runs, by one-sided tolerance intervals: verified, refuted or undecided.

The consumer's risk is the probability of accepting a design that meets the requirement in just less than the demanded
fraction of runs (Hanson and Beard, NASA/TP-2010-216447).
"""

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from rpojax.analysis.statistics.intervals import success_bounds
from rpojax.analysis.statistics.tolerance_bounds import allowed_failures, consumer_risk_reached, runs_for_bound
from rpojax.campaign.group_sequential_bounds import Decision, LookPath
from rpojax.scenario.schema import RequirementSection
from rpojax.simulation.outcomes.requirement_violations import severity_of, worse_sign

_MAX_IDS = 20
VIOLATED = "violated"
"""A requirement in words that is not verified: the violations refute it, and no further runs can help."""
OUT_OF_REACH = "open: more runs at this rate of violations would not verify it"
"""A requirement in words that is not decided by runs of which more violate it than may."""


class Verdict(StrEnum):
    """Verdict on a requirement."""

    VERIFIED = "verified"
    NOT_VERIFIED = "not verified"
    MORE_RUNS = "needs more runs"
    UNDECIDED = "undecided by all runs of the plan"
    NO_RUNS = "no run counts: no verdict"
    NOT_INDEPENDENT = "not independent: no verdict"
    UNFINISHED = "unfinished: no verdict"
    UNSEALED = "unsealed: no verdict"


@dataclass(frozen=True)
class RequirementEvaluation:
    """A requirement evaluated on the runs of a campaign.

    Where runs are not independent, some are missing, or nothing says that they are as they were written, what rests on
    that is None: missing runs may well be the bad ones. Values are in the metric's unit.

    Attributes:
        requirement: that was evaluated
        verdict: on it
        more_runs: fewest further runs, none of them in violation, that would verify; where only some of the runs count,
            about as many as it takes for enough of them to count; None with another verdict
        runs: that were evaluated: those that count
        not_counted: runs of another outcome than the requirement's, or never in its phase if it is of those that are
        violations: runs beyond the limit, without the metric, or never in the phase
        allowed: most violations with which this number of runs verifies; None if there are too few runs
        rank: of the run that must keep the limit, 1 is the best; None if too few runs
        order_statistic: value of that run; None if too few runs, or if it has no metric
        margin: from that value to the limit, positive inside; None without it
        without_value: violating runs that do not have the metric, as after the end at the keep-out sphere
        worst: worst value of the runs that have one; None if none has
        success_fraction: fraction of runs without violation; None without runs
        success_interval: exact bounds of the probability of success, each of them wrong with the consumer's risk
        risk_reached: smallest consumer's risk at which the runs would verify
        decision: look of a sequential campaign that decided; None without one, and with a fixed number of runs
        looks: taken at a sequential campaign
        violating_ids: numbers of at most 20 violating runs, those without a value first, then the worst
    """

    requirement: RequirementSection
    verdict: Verdict
    more_runs: int | None
    runs: int
    not_counted: int
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
    decision: Decision | None = None
    looks: LookPath | None = None

    @property
    def beyond_limit(self) -> int:
        """Runs with a value beyond the limit."""
        return self.violations - self.without_value

    @property
    def is_out_of_reach(self) -> bool:
        """Whether it is not decided, but so large a share violates that more runs at that rate would not verify it."""
        share = self.success_fraction
        is_open = self.more_runs is not None and self.violations > 0 and self.runs > 1
        return is_open and share is not None and share <= self.requirement.probability

    @property
    def text(self) -> str:
        """The verdict in words, with the number of missing runs; of a single run, which cannot verify, what it did.

        That number is of runs without a violation, so that it is the least one where some violate.
        """
        if self.verdict is Verdict.NOT_VERIFIED:
            return VIOLATED
        if self.more_runs is None:
            return self.verdict
        if self.runs == 1 and not self.not_counted:
            return f"{'violated' if self.violations else 'kept'} by the one run, which gives no verdict"
        if self.is_out_of_reach:
            return OUT_OF_REACH
        least = "at least " if self.violations else ""
        return f"needs {least}{self.more_runs} more {'run' if self.more_runs == 1 else 'runs'}"


def evaluate_requirement(
    requirement: RequirementSection,
    values: np.ndarray,
    run_ids: np.ndarray,
    independent: bool,
    missing: int = 0,
    counted: np.ndarray | None = None,
    sealed: bool = True,
    looks: LookPath | None = None,
) -> RequirementEvaluation:
    """Evaluates a requirement by the metric's `values` (n,), NaN where undefined, of runs with `run_ids` (n,).

    While `missing` requested runs are not done there is no verdict, and none of a folder that is not `sealed`. Flags
    `counted` (n,) of `counts`; by default all. With the `looks` of a sequential campaign, verdict, bounds and risk are
    those of the plan with all its looks.
    """
    not_counted = 0 if counted is None else int(np.sum(~counted))
    if counted is not None:
        values, run_ids = values[counted], run_ids[counted]
    severity = severity_of(requirement, values)
    violating = severity > worse_sign(requirement) * requirement.limit
    count, runs = int(violating.sum()), len(values)
    judged = _NOT_JUDGED
    if independent and not missing and sealed:
        judged = _by_plan(requirement, count, runs) if looks is None else _by_looks(requirement, looks)
        if not runs and not_counted:
            judged = replace(judged, verdict=Verdict.NO_RUNS)
    verdict = judged.verdict or _without_verdict(independent, sealed)
    rank = None if judged.allowed is None else runs - judged.allowed
    at_rank = None if rank is None else _value(requirement, np.sort(severity)[rank - 1])
    return RequirementEvaluation(
        requirement=requirement,
        verdict=verdict,
        more_runs=_more_runs(requirement, count, runs, not_counted) if verdict is Verdict.MORE_RUNS else None,
        runs=runs,
        not_counted=not_counted,
        violations=count,
        allowed=judged.allowed,
        rank=rank,
        order_statistic=at_rank,
        margin=None if at_rank is None else worse_sign(requirement) * (requirement.limit - at_rank),
        without_value=int(np.sum(np.isinf(severity))),
        worst=_value(requirement, np.max(severity[np.isfinite(severity)], initial=-np.inf)),
        success_fraction=1.0 - count / runs if runs else None,
        success_interval=judged.interval,
        risk_reached=judged.risk_reached,
        violating_ids=_worst_first(severity, violating, run_ids),
        decision=judged.decision,
        looks=looks,
    )


def _without_verdict(independent: bool, sealed: bool) -> Verdict:
    if not sealed:
        return Verdict.UNSEALED
    return Verdict.UNFINISHED if independent else Verdict.NOT_INDEPENDENT


@dataclass(frozen=True)
class _Judged:
    """Verdict, and what it rests on; None where there is none."""

    verdict: Verdict | None = None
    allowed: int | None = None
    interval: tuple[float, float] | None = None
    risk_reached: float | None = None
    decision: Decision | None = None


_NOT_JUDGED = _Judged()


def _by_plan(requirement: RequirementSection, count: int, runs: int) -> _Judged:
    """Verdict by `count` violations of a number of runs that was fixed before."""
    probability, risk = requirement.probability, requirement.consumer_risk
    allowed, interval = allowed_failures(runs, probability, risk), success_bounds(count, runs, risk)
    verdict = Verdict.NOT_VERIFIED if interval[1] < probability else Verdict.MORE_RUNS
    if allowed is not None and count <= allowed:
        verdict = Verdict.VERIFIED
    return _Judged(verdict, allowed, interval, consumer_risk_reached(count, runs, probability))


def _by_looks(requirement: RequirementSection, looks: LookPath) -> _Judged:
    """Verdict by the first look that decided, with the bounds of a plan of which each look takes its share of risk."""
    probability, risk = requirement.probability, requirement.consumer_risk
    decision = looks.decision(probability, risk)
    verdict = Verdict.UNDECIDED
    if decision is not None:
        verdict = Verdict.VERIFIED if decision.verified else Verdict.NOT_VERIFIED
    allowed = [each.allowed for each in looks.bounds(probability, risk) if each.allowed is not None]
    interval = looks.success_bounds(probability, risk)
    return _Judged(verdict, max(allowed, default=None), interval, looks.risk_reached(probability, risk), decision)


def _more_runs(requirement: RequirementSection, count: int, runs: int, not_counted: int) -> int:
    """Fewest further runs, none of them in violation, that verify a requirement with `count` violations so far.

    Of these the same share counts as of those so far.
    """
    missing = max(1, runs_for_bound(requirement.probability, 1.0 - requirement.consumer_risk, count + 1) - runs)
    return math.ceil(missing * (runs + not_counted) / runs) if runs else missing


def _value(requirement: RequirementSection, severity: float) -> float | None:
    return worse_sign(requirement) * float(severity) if np.isfinite(severity) else None


def _worst_first(severity: np.ndarray, violating: np.ndarray, run_ids: np.ndarray) -> tuple[int, ...]:
    order = np.lexsort((run_ids, -severity))
    return tuple(run_ids[order[violating[order]]][:_MAX_IDS].tolist())
