"""Paired comparison of campaigns: worked numbers, pairs put together by run number, and intervals that cover."""

import numpy as np
import pytest
from scipy import stats

from rpojax.analysis.statistics.paired_comparison import (
    RunMetrics,
    compare_paired_runs,
    count_paired_events,
    mcnemar_p,
)
from rpojax.errors import ResultError
from rpojax.scenario.schema import RequirementSection

ERROR = "formation_error_rms_m"


def runs(ids: np.ndarray, values: np.ndarray, completed: np.ndarray | None = None) -> RunMetrics:
    """A campaign with one metric."""
    outcomes = np.where(np.ones(len(ids), bool) if completed is None else completed, "completed", "lost")
    return RunMetrics(ids, outcomes, {ERROR: values})


def test_mcnemar_against_a_worked_number() -> None:
    assert mcnemar_p(15, 5) == pytest.approx(0.0413895, abs=5e-8)
    assert mcnemar_p(5, 15) == mcnemar_p(15, 5)
    assert mcnemar_p(0, 0) == 1.0


def test_pairs_are_counted_by_who_has_the_event() -> None:
    first = np.repeat([True, True, False, False], [2, 15, 5, 30])
    second = np.repeat([True, False, True, False], [2, 15, 5, 30])
    found = count_paired_events("failed", first, second, independent=True)
    assert (found.both, found.only_first, found.only_second, found.neither) == (2, 15, 5, 30)
    assert found.p_value == pytest.approx(0.0413895, abs=5e-8)
    assert count_paired_events("failed", first, second, independent=False).p_value is None


def test_runs_are_paired_by_their_number_whatever_their_order() -> None:
    values = np.random.default_rng(0).normal(5.0, 1.0, 40)
    ids = np.arange(100, 140)
    turned = np.random.default_rng(1).permutation(40)
    later = runs(np.append(ids[turned], [7, 8]), np.append(values[turned] + 0.25, [0.0, 0.0]))
    found = compare_paired_runs(runs(ids, values), later, [], independent=True)
    assert (found.pairs, found.unpaired) == (40, 2)
    [change] = found.metrics
    assert change.first == pytest.approx(np.median(values))
    assert change.difference.value == pytest.approx(0.25)
    # Every pair differs by as much, so every resampled median does.
    assert change.difference.interval_95 == pytest.approx((0.25, 0.25))
    assert change.ratio.value == pytest.approx(change.second / change.first)


def test_failures_and_violations_are_compared_run_by_run() -> None:
    wanted = RequirementSection(metric=ERROR, bound="at most", limit=2.0, probability=0.9, consumer_risk=0.1)
    ids = np.arange(6)
    first = runs(ids, np.array([1.0, 3.0, np.nan, 1.0, 3.0, 1.0]), np.array([1, 1, 0, 1, 1, 1], bool))
    second = runs(ids, np.array([1.0, 1.0, 1.0, 3.0, 3.0, np.nan]), np.array([1, 1, 1, 1, 1, 0], bool))
    found = compare_paired_runs(first, second, [wanted], independent=True)
    assert (found.failures.only_first, found.failures.only_second, found.failures.neither) == (1, 1, 4)
    [violated] = found.requirements
    assert violated.event == "not formation_error_rms_m at most 2"
    assert (violated.both, violated.only_first, violated.only_second, violated.neither) == (1, 2, 2, 1)
    assert found.metrics[0].pairs == 4


def test_interval_of_the_difference_covers_as_often_as_it_says() -> None:
    rng = np.random.default_rng(4)
    covered = np.zeros((0, 2), bool)
    for seed in range(60):
        common = rng.normal(size=60)
        first, second = (common + 0.5 * rng.normal(size=60) + shift for shift in (3.0, 3.4))
        found = compare_paired_runs(runs(np.arange(60), first), runs(np.arange(60), second), [], True, seed).metrics[0]
        ends = [found.difference.interval_90, found.difference.interval_95]
        inside = [low <= 0.4 <= high for low, high in (end for end in ends if end is not None)]
        covered = np.append(covered, [inside], axis=0)
    shares = covered.mean(axis=0)
    assert shares[1] >= shares[0]
    # Percentile intervals of medians cover rather more than they say; four sigma below for sixty draws.
    assert shares[0] > stats.binom.ppf(3e-5, 60, 0.9) / 60.0
    assert shares[0] < 1.0


def test_a_campaign_of_twice_the_values_has_a_ratio_of_two_with_both_ends() -> None:
    values = np.random.default_rng(2).normal(5.0, 1.0, 40)
    [change] = compare_paired_runs(runs(np.arange(40), values), runs(np.arange(40), 2.0 * values), [], True).metrics
    assert change.ratio.value == pytest.approx(2.0)
    assert change.ratio.interval_95 == pytest.approx((2.0, 2.0))


def test_wider_levels_and_other_seeds() -> None:
    rng = np.random.default_rng(5)
    first, second = runs(np.arange(200), rng.normal(size=200)), runs(np.arange(200), rng.normal(size=200))
    found, again, other = (compare_paired_runs(first, second, [], True, seed).metrics[0] for seed in (1, 1, 2))
    assert found == again
    assert found != other
    narrow, wide = found.difference.interval_90, found.difference.interval_95
    assert narrow is not None
    assert wide is not None
    assert wide[0] <= narrow[0] < narrow[1] <= wide[1]


def test_a_ratio_to_zero_is_undefined_and_has_no_interval() -> None:
    zeros, ones = runs(np.arange(30), np.zeros(30)), runs(np.arange(30), np.ones(30))
    [found] = compare_paired_runs(zeros, ones, [], independent=True).metrics
    assert (found.ratio.value, found.ratio.interval_95) == (None, None)
    assert found.difference.interval_95 == (1.0, 1.0)
    mixed = runs(np.arange(30), np.repeat([0.0, 1.0], [13, 17]))
    [found] = compare_paired_runs(mixed, ones, [], independent=True).metrics
    assert (found.ratio.value, found.ratio.interval_95) == (1.0, None)


def test_without_enough_or_independent_pairs_there_are_no_intervals() -> None:
    few = runs(np.arange(9), np.arange(9.0))
    assert compare_paired_runs(few, few, [], independent=True).metrics[0].difference.interval_90 is None
    many = runs(np.arange(90), np.arange(90.0))
    found = compare_paired_runs(many, many, [], independent=False)
    assert found.metrics[0].difference.interval_90 is None
    assert found.metrics[0].difference.value == 0.0
    assert found.failures.p_value is None
    nothing = runs(np.arange(9), np.full(9, np.nan))
    [undefined] = compare_paired_runs(nothing, few, [], independent=True).metrics
    assert (undefined.pairs, undefined.difference.value) == (0, None)


def test_campaigns_of_other_runs_are_refused() -> None:
    with pytest.raises(ResultError, match="run numbers: found none"):
        compare_paired_runs(runs(np.arange(3), np.ones(3)), runs(np.arange(3, 6), np.ones(3)), [], independent=True)


def test_requirements_on_what_one_campaign_lacks_are_left_out_whichever_it_is() -> None:
    common = {"bound": "at least", "limit": 2.0, "probability": 0.9, "consumer_risk": 0.1}
    unknown = RequirementSection(metric="min_range_m", **common)
    in_phase = RequirementSection(metric=ERROR, phase="near", **common)
    known = RequirementSection(metric=ERROR, **common)
    one, other = runs(np.arange(3), np.ones(3)), runs(np.arange(3), np.ones(3))
    window = in_phase.window
    metrics = {**other.metrics, "min_range_m": np.ones(3), in_phase.metric_name: np.ones(3)}
    other = RunMetrics(other.run_ids, other.outcomes, {**metrics, window.presence_name: np.ones(3)})
    for pair in ((one, other), (other, one)):
        found = compare_paired_runs(*pair, [unknown, in_phase, known], independent=True)
        assert [each.event for each in found.requirements] == [f"not {ERROR} at least 2"]
    every = compare_paired_runs(other, other, [unknown, in_phase, known], independent=True).requirements
    assert [each.both for each in every] == [3, 3, 3]


def test_outcomes_that_occur_are_counted_by_pairs() -> None:
    ids, values = np.arange(4), np.ones(4)
    first = RunMetrics(ids, np.array(["lost", "lost", "completed", "completed"]), {ERROR: values})
    second = RunMetrics(ids, np.array(["lost", "off_station", "completed", "completed"]), {ERROR: values})
    found = compare_paired_runs(first, second, [], independent=True)
    counts = {each.event: (each.both, each.only_first, each.only_second, each.neither) for each in found.outcomes}
    assert counts == {"lost": (1, 1, 0, 2), "off_station": (0, 0, 1, 3)}
    assert (found.failures.both, found.failures.neither) == (2, 2)
