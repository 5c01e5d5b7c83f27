"""Bounds of violations at planned looks: their risks by enumeration, a single look, and intervals that agree."""

import itertools
import math

import numpy as np
import pytest
from scipy.stats import binom

from rpojax.analysis.statistics import intervals, tolerance_bounds
from rpojax.campaign import group_sequential_bounds
from rpojax.campaign.group_sequential_bounds import LookBounds, LookPath, decide, look_bounds

LOOKS = (30, 60, 90, 120)
FRACTIONS = (0.25, 0.5, 0.75, 1.0)


def probabilities(bounds: tuple[LookBounds, ...], looks: tuple[int, ...], rate: float) -> tuple[float, float]:
    """Probabilities to verify and to refute at a rate of violations, by enumeration of the violations in each part."""
    steps = np.diff((0, *looks))
    likely = [range(int(binom.isf(1e-7, step, rate)) + 2) for step in steps]
    weights = [binom.pmf(counts, step, rate) for counts, step in zip(likely, steps, strict=True)]
    verified = refuted = 0.0
    for counts, shares in zip(itertools.product(*likely), itertools.product(*weights), strict=True):
        found = decide(bounds, list(itertools.accumulate(counts)))
        if found is not None:
            verified += math.prod(shares) * found.verified
            refuted += math.prod(shares) * (not found.verified)
    return verified, refuted


@pytest.mark.parametrize(("probability", "risk"), [(0.95, 0.1), (0.9, 0.05)])
def test_neither_risk_is_above_that_stated_at_the_limit(probability: float, risk: float) -> None:
    bounds = look_bounds(LOOKS, FRACTIONS, probability, risk)
    verified, refuted = probabilities(bounds, LOOKS, 1.0 - probability)
    assert 0.5 * risk < verified <= risk + 1e-6
    assert 0.5 * risk < refuted <= risk + 1e-6
    worse, better = (probabilities(bounds, LOOKS, factor * (1.0 - probability)) for factor in (1.3, 0.7))
    assert worse[0] < verified < better[0]
    assert better[1] < refuted < worse[1]


def test_one_look_alone_verifies_with_the_violations_of_a_fixed_number_of_runs() -> None:
    for runs in (20, 230, 388, 1000):
        [bound] = look_bounds((runs,), (1.0,), 0.99, 0.1)
        assert bound.allowed == tolerance_bounds.allowed_failures(runs, 0.99, 0.1)
        path = LookPath((runs,), (1.0,), (3,))
        np.testing.assert_allclose(path.success_bounds(0.99, 0.1), intervals.success_bounds(3, runs, 0.1), atol=1e-9)
        expected = tolerance_bounds.consumer_risk_reached(3, runs, 0.99)
        np.testing.assert_allclose(path.risk_reached(0.99, 0.1), expected, rtol=1e-9)


def test_looks_without_a_run_that_counts_decide_nothing_and_spend_nothing() -> None:
    late = look_bounds((0, 0, 90, 120), FRACTIONS, 0.95, 0.1)
    assert late[:2] == (LookBounds(None, None),) * 2
    assert late[2:] == look_bounds((90, 120), (0.75, 1.0), 0.95, 0.1)


@pytest.mark.parametrize("violations", [(0, 0, 0, 0), (1, 2, 3, 4), (6, 9, 15, 22), (0, 2, 4, 6)])
def test_bounds_of_success_agree_with_the_decision(violations: tuple[int, ...]) -> None:
    path = LookPath(LOOKS, FRACTIONS, violations)
    found = path.decision(0.95, 0.1)
    low, high = path.success_bounds(0.95, 0.1)
    assert (low >= 0.95) == (found is not None and found.verified)
    assert (high < 0.95) == (found is not None and not found.verified)
    assert low <= 1.0 - violations[-1] / LOOKS[-1] <= high
    assert (path.risk_reached(0.95, 0.1) <= 0.1) == (found is not None and found.verified)


def test_the_first_look_that_decides_is_final() -> None:
    bounds = look_bounds(LOOKS, FRACTIONS, 0.95, 0.1)
    first = next(number for number, bound in enumerate(bounds) if bound.allowed is not None)
    violations = [0] * (first + 1) + [60] * (len(LOOKS) - first - 1)
    found = decide(bounds, violations)
    assert found is not None
    assert (found.look, found.verified) == (first + 1, True)


def test_a_fixed_plan_keeps_both_risks() -> None:
    runs = group_sequential_bounds.fixed_runs(0.99, 0.1)
    allowed = tolerance_bounds.allowed_failures(runs, 0.99, 0.1)
    assert (runs, allowed) == (667, 3)
    assert binom.cdf(allowed, runs, 0.0025) >= 0.9
