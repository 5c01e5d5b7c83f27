"""Plain sampling: the share of failures among independent points."""

import math
from collections.abc import Sequence

import numpy as np

from rpojax.analysis.reliability.rare_events.limit_state_calls import LimitStateCalls, undefined_fault
from rpojax.analysis.reliability.rare_events.probability_estimate import (
    LevelRecord,
    ProbabilityEstimate,
    binomial_interval,
)

MIN_FAILURES = 10
"""Failures below which the interval is too wide to rest a decision on."""
_BATCH = 4096


def estimate(
    calls: LimitStateCalls, rng: np.random.Generator, reason: str, earlier: Sequence[np.ndarray] = ()
) -> ProbabilityEstimate:
    """Probability from all evaluations that are left, and from margins of independent points that are there already."""
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
        interval_95=binomial_interval(failures, runs),
        coefficient_of_variation=math.sqrt((1.0 - probability) / failures) if failures else math.inf,
        evaluations=calls.used,
        method="plain",
        trusted=failures >= MIN_FAILURES and not faults,
        warnings=(*warnings, *faults, *calls.undefined_remark()),
        reason=reason,
        effective_sample_size=float(failures),
        levels=(LevelRecord("plain samples", runs, probability),),
    )
