"""Probability of failure by the method asked for, or by the one that suits the failures found so far."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from rpojax.analysis.reliability.rare_events import exploration, importance_sampling, line_sampling, subset_simulation
from rpojax.analysis.reliability.rare_events.exploration import Exploration
from rpojax.analysis.reliability.rare_events.importance_sampling import Round
from rpojax.analysis.reliability.rare_events.latent_points import LatentPoints, LimitStateCalls, undefined_fault
from rpojax.analysis.reliability.rare_events.probability_estimate import (
    DesignPoint,
    LevelRecord,
    MethodChoice,
    ProbabilityEstimate,
    log_normal_interval,
)
from rpojax.analysis.reliability.rare_events.subset_simulation import SubsetResult
from rpojax.analysis.statistics.intervals import clopper_pearson_interval

MIN_FAILURES = 10
"""Failures below which the interval is too wide to rest a decision on."""
_BATCH = 4096
_PLAIN_VARIATION = 0.06
"""Coefficient of variation that plain sampling must reach with the whole budget to be chosen."""
_ROUND_SHARE = 0.07
"""Share of the budget for each round that adapts the proposal of importance sampling."""
_POOR_VARIATION = 0.35
"""Expected coefficient of variation of importance sampling above which subset simulation is used instead."""
_MIN_ROUND_EFFECTIVE = 12.0
"""Effective failures of the last round below which its weights are too few to show whether they can be trusted."""
_SURPRISE = 3.0
"""Standard deviations by which two estimates must differ to contradict each other."""
_SUBSET_CAUTION = 1.3
"""Factor on the coefficient of variation of subset simulation to allow for the dependence between its levels."""
_ANNEALING_VARIATION = 0.7
"""Coefficient of variation assumed of the probability by scale annealing."""
_UNCOVERED = 0.1
"""Share of failures where the proposal hardly draws, above which it is said to miss a part of failure."""
_ASKED = "asked for"
"""Reason of a method that the user names."""
Samples = tuple[LatentPoints, np.ndarray]


def plain_estimate(
    calls: LimitStateCalls, rng: np.random.Generator, reason: str, earlier: Sequence[np.ndarray] = ()
) -> ProbabilityEstimate:
    """Probability from the remaining evaluations and from `earlier` margins of independent points."""
    margins = list(earlier)
    while calls.left > 0:
        margins.append(calls.margins(calls.space.sample(rng, min(_BATCH, calls.left))))
    return from_margins(np.concatenate(margins), calls, reason)


def from_margins(margins: np.ndarray, calls: LimitStateCalls, reason: str) -> ProbabilityEstimate:
    """Probability from margins (n,) of independent points."""
    runs, failures = len(margins), int((margins <= 0.0).sum())
    probability = failures / runs
    warnings = []
    if failures == 0:
        warnings.append(f"no failure in {runs} plain samples: the upper end of the interval is all that is known")
    elif failures < MIN_FAILURES:
        warnings.append(f"{failures} failures in {runs} plain samples are few")
    faults = undefined_fault(margins, np.ones(runs))
    return ProbabilityEstimate(
        probability=probability,
        interval_95=clopper_pearson_interval(failures, runs),
        coefficient_of_variation=math.sqrt((1.0 - probability) / failures) if failures else math.inf,
        evaluations=calls.used,
        method="plain",
        trusted=failures >= MIN_FAILURES and not faults,
        warnings=(*warnings, *faults, *calls.undefined_remark()),
        reason=reason,
        effective_sample_size=float(failures),
        levels=(LevelRecord("plain samples", runs, probability),),
    )


def estimate(calls: LimitStateCalls, rng: np.random.Generator, method: MethodChoice) -> ProbabilityEstimate:
    """Probability of failure by a method, or by the one that suits the limit state."""
    if method == "plain":
        return plain_estimate(calls, rng, _ASKED)
    points = calls.space.sample(rng, int(exploration.FIRST_SHARE * calls.budget), in_blocks=True)
    first = (points, calls.margins(points))
    if method == "subset":
        return _by_subset(calls, rng, first, _ASKED)
    if method == "line":
        return line_sampling.estimate(calls, rng, first, _ASKED)
    if method == "auto" and _plain_is_enough(first[1], calls.budget):
        reason = "failures are so frequent that plain sampling is accurate enough"
        return plain_estimate(calls, rng, reason, (first[1],))
    found = exploration.explore(calls, rng, first)
    failures = found.failures
    if failures is None:
        reason = "neither subset simulation nor wider distributions found a failure"
        return plain_estimate(calls, rng, reason, (first[1],))
    size = min(max(20, int(_ROUND_SHARE * calls.budget)), calls.left // 2)
    proposal, rounds = importance_sampling.adapted(calls, rng, failures, size)
    expected = math.sqrt(rounds[-1].variance_of_one / max(1, calls.left))
    poor = expected > _POOR_VARIATION or rounds[-1].effective_size < _MIN_ROUND_EFFECTIVE
    if method == "auto" and poor and found.subset.complete:
        reason = "weights of importance sampling would degenerate"
        return _by_subset(calls, rng, first, reason, (found.subset,), rounds)
    if method == "auto" and found.subset.complete:
        reason = f"a proposal fitted to the failures promises a coefficient of variation of {100.0 * expected:.2g} %"
    else:
        reason = _ASKED if method == "importance" else "margins do not rank the points, but failures were found"
    last = importance_sampling.draw_round(calls, rng, proposal, calls.left)
    return _by_importance(calls, last, found, rounds, reason)


def _plain_is_enough(margins: np.ndarray, budget: int) -> bool:
    """Whether plain sampling with the whole budget is accurate enough, judged by the first margins."""
    share = float((margins <= 0.0).mean())
    return share * budget * _PLAIN_VARIATION**2 >= 1.0 - share


def _by_importance(
    calls: LimitStateCalls, last: Round, found: Exploration, rounds: list[Round], reason: str
) -> ProbabilityEstimate:
    """Estimate by the last round of importance sampling, and what earlier stages say about it."""
    faults = importance_sampling.weight_warnings(last)
    faults += _missed_failures(found, last)
    remarks = []
    points = importance_sampling.design_points(last)
    if len(points) > 1:
        remarks.append(_regions(points))
    faults += undefined_fault(last.margins, last.weights)
    remarks += calls.undefined_remark()
    levels = [*found.subset.levels, *found.annealing.levels]
    levels += [LevelRecord("importance round", len(each.margins), each.probability) for each in (*rounds, last)]
    has_failed = last.probability > 0.0
    return ProbabilityEstimate(
        probability=last.probability,
        interval_95=importance_sampling.interval(last) if has_failed else (0.0, 1.0),
        coefficient_of_variation=last.variation,
        evaluations=calls.used,
        method="importance",
        trusted=not faults,
        warnings=(*faults, *remarks),
        reason=reason,
        effective_sample_size=last.effective_size,
        levels=tuple(levels),
        design_points=points,
    )


def _missed_failures(found: Exploration, last: Round) -> list[str]:
    """Warnings about earlier estimates so much larger that importance sampling must have missed failures.

    A small subset simulation may itself be far off, so there is a warning only if its failures also lie where the
    proposal hardly draws.
    """
    faults = []
    for name, probability, variation, x in (
        ("subset simulation", found.subset.probability, found.subset.variation, found.subset.failures[0].x),
        ("scale annealing", found.annealing.probability, _ANNEALING_VARIATION, found.annealing.failures.x),
    ):
        if probability is None or len(x) == 0:
            continue
        spread = math.sqrt(math.log1p(variation**2) + math.log1p(min(last.variation, 1e3) ** 2))
        gap = math.log(probability / last.probability) if last.probability > 0.0 else math.inf
        if gap > _SURPRISE * spread and importance_sampling.uncovered_share(x, last) > _UNCOVERED:
            faults.append(f"{name} found {probability:.3g}: the proposal misses a part of failure")
    return faults


def _regions(points: tuple[DesignPoint, ...]) -> str:
    """Several design points in words."""
    shares = ", ".join(f"{100.0 * point.share:.0f} % at {point.distance:.2f} sigmas" for point in points[:4])
    opposite = any(
        float(a.x @ b.x) < -0.5 * a.distance * b.distance for i, a in enumerate(points) for b in points[i + 1 :]
    )
    side = ", on opposite sides" if opposite else ""
    return f"several design points{side}: {shares}"


def _by_subset(
    calls: LimitStateCalls,
    rng: np.random.Generator,
    first: Samples,
    reason: str,
    earlier: tuple[SubsetResult, ...] = (),
    rounds: list[Round] | None = None,
) -> ProbabilityEstimate:
    """Estimate by two subset simulations, the second with the evaluations that the first leaves."""
    results = list(earlier)
    if not results:
        results.append(subset_simulation.simulate(calls, rng, max(60, calls.budget // 20), calls.left, first))
    levels = len(results[0].levels)
    per_level = int(calls.left / (1.0 + 0.92 * levels))
    if per_level >= 50 and not results[0].flat:
        results.append(subset_simulation.simulate(calls, rng, per_level, calls.left))
    complete = [result for result in results if result.complete]
    used = complete or results
    precisions = np.array([1.0 / max(each.variation, 1e-3) ** 2 for each in used])
    shares = precisions / precisions.sum()
    probability = float(sum(share * each.probability for share, each in zip(shares, used, strict=True)))
    variation = _SUBSET_CAUTION / math.sqrt(precisions.sum())
    faults = _subset_faults(results, complete, variation)
    if (
        rounds
        and rounds[-1].probability > 0.0
        and math.log(rounds[-1].probability / max(probability, 1e-300))
        > _SURPRISE * math.hypot(math.sqrt(math.log1p(variation**2)), min(rounds[-1].variation, 2.0))
    ):
        faults.append(f"importance sampling found {rounds[-1].probability:.3g}: chains miss a part of failure")
    last = np.concatenate([each.last.margins for each in used])
    faults += undefined_fault(last, np.ones(len(last)))
    if not complete:
        return _without_failure(calls, rng, first, results, faults, reason)
    return ProbabilityEstimate(
        probability=probability,
        interval_95=log_normal_interval(probability, variation),
        coefficient_of_variation=variation,
        evaluations=calls.used,
        method="subset",
        trusted=not faults,
        warnings=(*faults, *calls.undefined_remark()),
        reason=reason,
        effective_sample_size=1.0 / variation**2,
        levels=tuple(level for each in results for level in each.levels),
    )


def _subset_faults(results: list[SubsetResult], complete: list[SubsetResult], variation: float) -> list[str]:
    """Reasons to distrust the subset simulations."""
    faults = []
    if any(result.flat for result in results):
        faults.append("margins are flat: subset simulation cannot rank the points")
    if len(complete) < len(results):
        faults.append("failure was not reached by all chains")
    if not all(each.mixing for each in results):
        faults.append("chains do not mix: hardly any move was accepted")
    if variation > 0.6:
        faults.append(f"the coefficient of variation is {100.0 * variation:.0f} %")
    if len(complete) == 2:
        a, b = complete
        gap = abs(math.log(a.probability / b.probability))
        if gap > _SURPRISE * math.hypot(a.variation, b.variation):
            faults.append(f"two subset simulations contradict each other: {a.probability:.3g} and {b.probability:.3g}")
    return faults


def _without_failure(
    calls: LimitStateCalls,
    rng: np.random.Generator,
    first: Samples,
    results: list[SubsetResult],
    faults: list[str],
    reason: str,
) -> ProbabilityEstimate:
    """Plain estimate with the rest of the budget, if the chains did not reach failure."""
    reason = f"subset simulation, {reason}, did not reach failure" if reason == _ASKED else reason
    found = plain_estimate(calls, rng, reason, (first[1],))
    levels = (*(level for result in results for level in result.levels), *found.levels)
    return dataclasses.replace(found, warnings=(*faults, *found.warnings), levels=levels)
