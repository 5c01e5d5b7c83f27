"""Statistics over time of hand-made records, against values worked out by hand."""

import numpy as np
import pytest

from rpojax.metrics import record_statistics
from rpojax.metrics.metric_definition import RunTiming, WeightedValue

TIMING = RunTiming(tick_s=0.5, decision_ticks=3)
EVER, NEVER = [True] * 4, [False] * 4


def flags(*rows: str) -> WeightedValue:
    """Flags (runs, ticks) that are true at the ticks with an x."""
    return WeightedValue(np.array([[each == "x" for each in row] for row in rows]), np.ones(0))


def test_sums_and_ratios_of_integers_and_flags_are_floats_and_undefined_without_a_whole() -> None:
    np.testing.assert_array_equal(record_statistics.sum_in_time(np.array([[True, True, False]])), [2.0])
    found = record_statistics.ratio(np.array([1, 2, 3]), np.array([4, 0, -1]))
    np.testing.assert_array_equal(found, [0.25, np.nan, np.nan])


def test_a_conditional_mean_leaves_out_what_has_no_weight() -> None:
    values = np.array([[1.0, 2.0, np.nan, 6.0]] * 2)
    given = WeightedValue(values, np.array([[True, False, False, True], NEVER]))
    np.testing.assert_array_equal(record_statistics.conditional_mean(given, TIMING), [3.5, np.nan])


def test_a_percentile_is_that_of_what_has_a_weight() -> None:
    values = np.array([[4.0, 1.0, 100.0, 2.0], [1.0, 2.0, 3.0, 4.0]])
    given = WeightedValue(values, np.array([[True, True, False, True], NEVER]))
    np.testing.assert_array_equal(record_statistics.percentile(50.0)(given, TIMING), [2.0, np.nan])
    np.testing.assert_allclose(record_statistics.percentile(75.0)(given, TIMING), [3.0, np.nan])


def test_the_autocorrelation_is_that_of_neighbours_that_both_have_a_weight() -> None:
    rows = np.array([[1.0, 2.0], [3.0, -1.0], [2.0, 2.0], [-1.0, 0.5]])
    weights = np.array([EVER, [True, True, False, True], [True, False, True, False]])
    given = WeightedValue(np.stack([rows] * 3), weights)
    # Products 1, 4 and -1; squares 5, 10, 8 and 1.25.
    expected = [4.0 / (7.5 + 9.0 + 4.625), 1.0 / 7.5, np.nan]
    np.testing.assert_allclose(record_statistics.lag_1_autocorrelation(given, TIMING), expected, rtol=1e-15)


@pytest.mark.parametrize("factor", [1.0, -1.0, 0.0])
def test_the_autocorrelation_is_one_of_a_constant_and_minus_one_of_one_that_alternates(factor: float) -> None:
    rows = np.array([3.0, -4.0]) * np.array([1.0, factor, factor**2, factor**3])[:, None]
    given = WeightedValue(rows[None], np.array([EVER]))
    np.testing.assert_allclose(record_statistics.lag_1_autocorrelation(given, TIMING), [factor], rtol=1e-15)


def test_first_and_longest_times_of_flags() -> None:
    given = flags("..x.xx.", ".......", "xxx.xx.")
    np.testing.assert_array_equal(record_statistics.time_to_first(given, TIMING), [1.0, np.nan, 0.0])
    np.testing.assert_array_equal(record_statistics.longest_streak(given, TIMING), [1.0, 0.0, 1.5])


@pytest.mark.parametrize(
    ("visible", "seen", "expected"),
    [
        (".xxxx..", "...x...", 1.0),
        (".xxxx..", ".......", 1.5),
        (".xx.xxx", "..x...x", 1.0),
        (".x.....", ".x.....", 0.0),
        ("xxxx...", ".......", np.nan),
        (".......", "xxxxxxx", np.nan),
    ],
)
def test_a_wait_lasts_from_a_rise_to_the_answer_or_to_the_fall(visible: str, seen: str, expected: float) -> None:
    pair = np.stack([flags(visible).value, flags(seen).value], axis=2)
    found = record_statistics.longest_wait(WeightedValue(pair, np.ones(0)), TIMING)
    np.testing.assert_array_equal(found, [expected])


@pytest.mark.parametrize(("first_tick", "expected"), [(0, 1.0), (1, 1.5), (2, 1.0)])
def test_the_longest_total_is_that_between_two_decisions(first_tick: int, expected: float) -> None:
    # Decisions at ticks 0, 3 and 6 of the record, or one or two ticks before.
    timing = RunTiming(tick_s=0.5, decision_ticks=3, first_tick=first_tick)
    found = record_statistics.longest_total_between_decisions(flags("..xxx.."), timing)
    np.testing.assert_array_equal(found, [expected])
