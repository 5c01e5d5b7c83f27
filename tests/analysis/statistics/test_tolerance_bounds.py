"""Bounds of quantiles against worked numbers, scipy and drawn samples."""

import numpy as np
import pytest
from scipy import stats

from rpojax.analysis.statistics import tolerance_bounds
from rpojax.analysis.statistics.tolerance_bounds import (
    allowed_failures,
    consumer_risk_reached,
    quantile_interval_ranks,
    quantile_upper_bound,
    runs_for_bound,
    upper_bound_rank,
)

WILKS = [
    (0.95, 0.95, 59),
    (0.99, 0.95, 299),
    (0.99, 0.90, 230),
    (0.9973, 0.90, 852),
    (0.9973, 0.95, 1109),
    (0.99865, 0.90, 1705),
]


class CountedBinomial:
    """The binomial distribution, asked at most a given number of times."""

    def __init__(self, limit: int) -> None:
        self.left = limit

    def cdf(self, count: int, runs: int, probability: float) -> float:
        self.left -= 1
        assert self.left >= 0
        return float(stats.binom.cdf(count, runs, probability))


# Before the others, which a search without an end would not let begin.
@pytest.mark.parametrize(("quantile", "confidence", "runs"), WILKS)
def test_the_search_for_a_number_of_runs_halves_an_interval(
    monkeypatch: pytest.MonkeyPatch, quantile: float, confidence: float, runs: int
) -> None:
    monkeypatch.setattr(tolerance_bounds, "binom", CountedBinomial(2 * runs.bit_length() + 2))
    assert runs_for_bound(quantile, confidence) == runs


@pytest.mark.parametrize(("quantile", "confidence", "runs"), WILKS)
def test_the_largest_of_wilks_number_of_runs_is_the_bound_and_of_one_less_is_not(
    quantile: float, confidence: float, runs: int
) -> None:
    assert runs_for_bound(quantile, confidence) == runs
    assert upper_bound_rank(runs, quantile, confidence) == runs
    assert upper_bound_rank(runs - 1, quantile, confidence) is None


@pytest.mark.parametrize(("rank", "runs"), [(2, 93), (3, 124)])
def test_second_and_third_largest_take_over_at_wilks_numbers(rank: int, runs: int) -> None:
    assert runs_for_bound(0.95, 0.95, rank) == runs
    assert upper_bound_rank(runs, 0.95, 0.95) == runs - rank + 1
    assert upper_bound_rank(runs - 1, 0.95, 0.95) == runs - 1 - (rank - 1) + 1


@pytest.mark.parametrize(
    ("runs", "allowed"), [(0, None), (851, None), (852, 0), (1000, 0), (2000, 2), (3000, 4), (5000, 8), (10000, 19)]
)
def test_failures_allowed_of_three_sigma_at_a_tenth_of_risk(runs: int, allowed: int | None) -> None:
    assert allowed_failures(runs, 0.9973, 0.1) == allowed


@pytest.mark.parametrize(("runs", "rank"), [(2000, 1998), (10000, 9981)])
def test_the_run_that_must_keep_the_limit_is_the_upper_bound_of_the_quantile(runs: int, rank: int) -> None:
    allowed = allowed_failures(runs, 0.9973, 0.1)
    assert allowed is not None
    assert runs - allowed == rank == upper_bound_rank(runs, 0.9973, 0.9)


def test_a_risk_that_is_met_exactly_is_met() -> None:
    # Two runs without violation of a fair coin: a quarter.
    assert allowed_failures(2, 0.5, 0.25) == 0
    assert allowed_failures(2, 0.5, 0.2499) is None


def test_consumer_risk_against_a_worked_number() -> None:
    assert consumer_risk_reached(3, 1000, 0.99) == pytest.approx(0.010073, abs=5e-7)
    assert consumer_risk_reached(0, 0, 0.99) == 1.0


def test_ranks_that_enclose_a_99th_percentile_and_how_often_they_do() -> None:
    assert quantile_interval_ranks(1000, 0.99) == (983, 997)
    coverage = stats.binom.cdf(996, 1000, 0.99) - stats.binom.cdf(982, 1000, 0.99)
    assert coverage == pytest.approx(0.97609, abs=5e-6)
    assert quantile_interval_ranks(100, 0.99) == (97, None)
    assert quantile_interval_ranks(3, 0.5) == (None, None)
    # The smallest and the largest of six enclose the median with 1 - 2 / 64.
    assert quantile_interval_ranks(6, 0.5) == (1, 6)


def test_rank_is_the_smallest_that_reaches_the_confidence() -> None:
    rank = upper_bound_rank(1000, 0.99, 0.95)
    assert rank is not None
    assert stats.binom.cdf(rank - 1, 1000, 0.99) >= 0.95 > stats.binom.cdf(rank - 2, 1000, 0.99)


def test_bound_is_an_order_statistic_and_none_with_too_few_runs() -> None:
    values = np.random.default_rng(0).permutation(np.arange(1.0, 300.0))
    assert quantile_upper_bound(values) == 299.0
    assert quantile_upper_bound(values[:298]) is None
    assert quantile_upper_bound(np.array([])) is None


def test_bound_covers_the_true_quantile_as_often_as_it_says() -> None:
    samples = np.random.default_rng(1).exponential(size=(2000, 473))
    bounds = np.array([quantile_upper_bound(row) for row in samples])
    rank = upper_bound_rank(473, 0.99, 0.95)
    assert rank is not None
    expected = stats.binom.cdf(rank - 1, 473, 0.99)
    assert np.mean(bounds >= -np.log(0.01)) == pytest.approx(expected, abs=0.015)
