"""Statistics over time that need the whole record of a run: streaks, waits, percentiles and autocorrelation."""

import numpy as np
from numpy.typing import NDArray

from rpojax.metrics.metric_definition import Floats, RecordStatistic, RunTiming, WeightedValue


def sum_in_time(values: NDArray[np.generic]) -> Floats:
    """Sum (runs,) over time of values (runs, ticks), in order of time.

    The order of summation of `numpy.sum` depends on the memory layout, so that the last bits would not be reproducible.
    """
    return np.add.accumulate(values, axis=1, dtype=float)[:, -1]


def ratio(part: NDArray[np.number], whole: NDArray[np.number]) -> Floats:
    """Quotient, NaN where `whole` is not positive."""
    return np.where(whole > 0, part / np.where(whole > 0, whole, 1), np.nan)


def conditional_mean(given: WeightedValue, _: RunTiming) -> Floats:
    """Mean over the ticks with a weight; NaN if no tick has one."""
    return ratio(sum_in_time(np.where(given.weight, given.value, 0.0)), sum_in_time(given.weight))


def percentile(percent: float) -> RecordStatistic:
    """Percentile of the values with a weight; NaN if no value has one."""

    def reduce(given: WeightedValue, _: RunTiming) -> Floats:
        values = np.where(given.weight, given.value, np.nan).astype(float)
        result = np.full(values.shape[0], np.nan)
        some = np.isfinite(values).any(axis=1)
        if some.any():
            result[some] = np.nanpercentile(values[some], percent, axis=1)
        return result

    return reduce


def lag_1_autocorrelation(given: WeightedValue, _: RunTiming) -> Floats:
    """Correlation of vectors one tick apart, over pairs that both have a weight; NaN without a pair.

    Its variance for white vectors is one over the number of products (Bar-Shalom, Li and Kirubarajan, 5.4.2).
    """
    rows = given.value
    pairs = given.weight[:, 1:] & given.weight[:, :-1]
    product = np.where(pairs, (rows[:, 1:] * rows[:, :-1]).sum(axis=2), 0.0)
    power = np.where(pairs, 0.5 * (rows[:, 1:] ** 2 + rows[:, :-1] ** 2).sum(axis=2), 0.0)
    return ratio(sum_in_time(product), sum_in_time(power))


def greatest_fall(given: WeightedValue, timing: RunTiming) -> Floats:
    """Greatest rate of decrease to a tick with a weight [1/s]; NaN where no such tick has one before it."""
    value = np.asarray(given.value, dtype=float)
    rates = np.where(given.weight[:, 1:], value[:, :-1] - value[:, 1:], np.nan) / timing.tick_s
    return np.fmax.reduce(rates, axis=1, initial=np.nan)


def time_to_first(flags: WeightedValue, timing: RunTiming) -> Floats:
    """Time of the first true flag [s]; NaN if no flag is true."""
    value = flags.value
    return np.where(value.any(axis=1), value.argmax(axis=1) * timing.tick_s, np.nan)


def longest_streak(flags: WeightedValue, timing: RunTiming) -> Floats:
    """Duration of the longest run of true flags [s]."""
    streak = np.zeros(flags.value.shape[0])
    longest = np.zeros(flags.value.shape[0])
    for column in flags.value.T:
        streak = np.where(column, streak + 1.0, 0.0)
        longest = np.maximum(longest, streak)
    return timing.tick_s * longest


def longest_wait(flags: WeightedValue, timing: RunTiming) -> Floats:
    """Longest time from the first of two flags becoming true to the second being true, or to the first's end [s].

    The value is (runs, ticks, 2); the result is NaN if the first flag never becomes true.
    """
    visible, seen = np.moveaxis(flags.value, 2, 0)
    waits = np.full(visible.shape[0], np.nan)
    waiting = np.zeros(visible.shape[0], dtype=bool)
    clock = np.zeros(visible.shape[0])
    for before, now, seen_now in zip(visible.T[:-1], visible.T[1:], seen.T[1:], strict=True):
        clock = np.where(now & ~before, 0.0, clock + 1.0)
        waiting = (waiting | (now & ~before)) & now
        waits = np.where(waiting, np.fmax(waits, clock), waits)
        waiting &= ~seen_now
    return timing.tick_s * waits


def longest_total_between_decisions(flags: WeightedValue, timing: RunTiming) -> Floats:
    """Longest total time with a true flag from one burn decision to the next [s]."""
    to_next = -timing.first_tick % timing.decision_ticks
    starts = np.union1d([0], np.arange(to_next, flags.value.shape[1], timing.decision_ticks))
    return timing.tick_s * np.add.reduceat(flags.value, starts, axis=1, dtype=float).max(1)
