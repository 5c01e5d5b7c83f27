"""Ticks and names of the windows of metrics, by hand."""

import numpy as np
import pytest

from rpojax.metrics.metric_definition import Window
from rpojax.metrics.time_windows import MetricWindow, first_tick, window_in_words


def flags(row: str) -> np.ndarray:
    return np.array([each == "x" for each in row])


@pytest.mark.parametrize(
    ("window", "ticks", "tick_s", "expected"),
    [
        ("all", 6, 1.0, 0),
        ("late", 6, 1.0, 2),
        ("last", 6, 1.0, 4),
        ("late", 8, 1.0, 2),
        ("last", 8, 1.0, 6),
        ("late", 4000, 1.0, 1000),
        ("last", 4000, 1.0, 3000),
        ("late", 4000, 0.5, 1333),
        ("late", 40000, 0.5, 2000),
        ("last", 40000, 0.5, 38000),
        ("late", 2, 1.0, 1),
        ("last", 2, 1.0, 1),
        ("late", 1, 1.0, 0),
        ("last", 1, 1.0, 0),
    ],
)
def test_late_and_last_windows_are_a_thousand_seconds_or_a_third(
    window: Window, ticks: int, tick_s: float, expected: int
) -> None:
    assert first_tick(window, ticks, tick_s) == expected


@pytest.mark.parametrize(
    ("from_s", "to_s", "ticks"),
    [(None, None, "xxxxxxxx"), (0.3, 0.6, "...xxxx."), (0.3, None, "...xxxxx"), (None, 0.6, "xxxxxxx."),
     (0.31, 0.59, "....xx.."), (0.6, 0.6, "......x."), (2.0, 3.0, "........")],
)  # fmt: skip
def test_both_times_count_whatever_the_rounding_of_a_tick(from_s: float | None, to_s: float | None, ticks: str) -> None:
    # In binary three and six ticks of 0.1 s are later than 0.3 and 0.6 s, six times 0.7 s is earlier than 4.2 s.
    assert 3 * 0.1 > 0.3
    assert 6 * 0.7 < 4.2
    np.testing.assert_array_equal(MetricWindow(from_s=from_s, to_s=to_s).between_times(8, 0.1), flags(ticks))
    longer = [None if each is None else round(7.0 * each, 6) for each in (from_s, to_s)]
    np.testing.assert_array_equal(MetricWindow(from_s=longer[0], to_s=longer[1]).between_times(8, 0.7), flags(ticks))


@pytest.mark.parametrize(
    ("at", "in_phase", "in_table", "expected"),
    [
        (None, "..xxx...", "xxxxxxxx", "..xxx..."),
        ("begin", "..xxx...", "xxxxxxxx", "..x....."),
        ("begin", "..xx.xx.", "xxxxxxxx", "..x....."),
        ("begin", "........", "xxxxxxxx", "........"),
        ("end", "..xxx...", "xxxxxxxx", "....x..."),
        ("end", "..xx.xx.", "xxxxxxxx", "......x."),
        # An abort is no other phase of the table, and the end of the run no end of the phase.
        ("end", "..xx.xx.", "xxxxxxx.", "...x...."),
        ("end", "..xxxxxx", "xxxxxxxx", "........"),
    ],
)
def test_an_end_of_a_phase_is_one_tick(at: str | None, in_phase: str, in_table: str, expected: str) -> None:
    window = MetricWindow(phase="approach", at=at)
    found = window.within(flags(in_phase)[None], flags(in_table)[None])
    np.testing.assert_array_equal(found, flags(expected)[None])


@pytest.mark.parametrize(
    ("window", "suffix", "presence", "words"),
    [
        (MetricWindow(), "", "duration_s", None),
        (MetricWindow(phase="hold_1"), "@hold_1", "duration_s@hold_1", "in hold_1"),
        (MetricWindow(phase="hold", at="end"), "@hold.end", "event_time_s@hold.end", "at the end of hold"),
        (MetricWindow(from_s=100.0, to_s=250.5), "@100-250.5", "duration_s@100-250.5", "from 100 to 250.5 s"),
        (MetricWindow(from_s=100.0), "@100-end", "duration_s@100-end", "from 100 s to the end"),
        (MetricWindow(to_s=250.0), "@0-250", "duration_s@0-250", "from 0 to 250 s"),
    ],
)
def test_a_window_has_a_name_and_words(window: MetricWindow, suffix: str, presence: str, words: str | None) -> None:
    assert window.suffix == suffix
    assert window.presence_name == presence
    assert window_in_words(suffix.removeprefix("@")) == words
