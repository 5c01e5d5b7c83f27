"""Error budgets of pointing and navigation: errors over windows of time, and what holds at a stated probability.

Source: ECSS-E-ST-60-10C, Control performance, 2008. With the performance error (actual minus desired) the indices are
APE, MPE, RPE, PDE and PRE; with the knowledge error (estimated minus actual) AKE, MKE, RKE, KDE and KRE.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rpojax.analysis.statistics.tolerance_bounds import quantile_upper_bound

Floats = NDArray[np.floating]
INDICES: Final = ("absolute", "mean", "relative", "drift", "reproducibility")
"""Error indices, in the order of the standard."""
PERFORMANCE: Final = dict(zip(INDICES, ("APE", "MPE", "RPE", "PDE", "PRE"), strict=True))
"""Abbreviations of the indices of a performance error."""
KNOWLEDGE: Final = dict(zip(INDICES, ("AKE", "MKE", "RKE", "KDE", "KRE"), strict=True))
"""Abbreviations of the indices of a knowledge error."""
_LEAST_DEFINED = 0.5
"""Share of the instants of a window that must be defined for its mean to count."""


@dataclass(frozen=True)
class BudgetWindows:
    """Windows of an error budget, in ticks; they follow each other from the first tick, and a rest is left out.

    Attributes:
        window: length of the window of a mean
        drift: from the beginning of the first to that of the second window of a drift, a multiple of `window`
        period: length of an observation period, a multiple of `window` longer than `drift`

    Raises:
        ValueError: a length is not of this kind.
    """

    window: int
    drift: int
    period: int

    def __post_init__(self) -> None:
        if self.window < 1 or self.drift % self.window or self.period % self.window:
            raise ValueError("drift and period: expected multiples of the window, of at least one tick")
        if not self.window <= self.drift < self.period:
            raise ValueError("drift: expected at least a window, and less than the observation period")


def window_means(error: Floats, window: int) -> Floats:
    """Means (..., windows, k) of an error (..., ticks, k) over windows of so many ticks that follow each other.

    Instants with a NaN are left out; the mean of a window with less than half of its instants is NaN.
    """
    rows = _in_windows(error, window)
    defined = np.isfinite(rows).all(axis=-1, keepdims=True)
    count = defined.sum(axis=-2)
    total = np.where(defined, rows, 0.0).sum(axis=-2)
    return np.where(count >= _LEAST_DEFINED * window, total / np.maximum(count, 1), np.nan)


def error_indices(error: Floats, windows: BudgetWindows) -> dict[str, Floats]:
    """Size of each of `INDICES` of a vector error (..., ticks, k), in its unit: a norm (..., instants or windows).

    `absolute` is of every tick, `mean` of each window, `relative` of the ticks in windows minus the mean of theirs,
    `drift` the difference of the means of two windows in one observation period, the stated time apart, and
    `reproducibility` that of windows at the same place in successive observation periods. NaN where undefined.
    """
    values = np.asarray(error, dtype=np.float64)
    means = window_means(values, windows.window)
    rows = _in_windows(values, windows.window)
    relative = rows - means[..., None, :]
    per_period = windows.period // windows.window
    lag = windows.drift // windows.window
    count = means.shape[-2]
    # A second window of a drift lies in the period of the first.
    first = np.array([place for place in range(count - lag) if place % per_period + lag < per_period], dtype=int)
    later, sooner = means[..., per_period:, :], means[..., : max(0, count - per_period), :]
    found = {
        "absolute": values,
        "mean": means,
        "relative": relative.reshape(*values.shape[:-2], -1, values.shape[-1]),
        "drift": means[..., first + lag, :] - means[..., first, :],
        "reproducibility": later - sooner,
    }
    return {name: np.linalg.norm(differences, axis=-1) for name, differences in found.items()}


def _in_windows(error: Floats, window: int) -> Floats:
    """Error (..., windows, window, k) from (..., ticks, k); ticks after the last whole window are left out."""
    count = error.shape[-2] // window
    return error[..., : count * window, :].reshape(*error.shape[:-2], count, window, error.shape[-1])


@dataclass(frozen=True)
class BudgetLine:
    """Size that an error keeps within with a stated probability, in its unit; None without a defined value.

    Attributes:
        runs: members of the ensemble, which have a defined value
        temporal: for the stated share of the time, of the worst member
        ensemble: at all times, for the stated share of the members
        ensemble_bound: upper confidence bound of `ensemble`; None with too few members for one
        mixed: for the stated share of instants and members, both drawn at random
    """

    runs: int
    temporal: float | None
    ensemble: float | None
    ensemble_bound: float | None
    mixed: float | None


def least_size_holding(sizes: Floats, probability: float) -> float:
    """Smallest of the `sizes` (n,) that at least the share `probability` of them does not exceed."""
    return float(np.quantile(sizes, probability, method="inverted_cdf"))


def budget_line(
    sizes: Floats | Sequence[Floats], probability: float, confidence: float = 0.95, independent: bool = True
) -> BudgetLine:
    """Three statistical interpretations of sizes of an error, (times,) of each run; NaN where it is undefined.

    Every member has the same weight in `mixed`, however many of its times are defined. Only `independent` runs have a
    confidence bound (of order statistics, for any distribution).
    """
    members = [row[np.isfinite(row)] for row in sizes]
    members = [row for row in members if len(row)]
    if not members:
        return BudgetLine(0, None, None, None, None)
    largest = np.array([row.max() for row in members])
    return BudgetLine(
        runs=len(members),
        temporal=max(least_size_holding(row, probability) for row in members),
        ensemble=least_size_holding(largest, probability),
        ensemble_bound=quantile_upper_bound(largest, probability, confidence) if independent else None,
        mixed=_weighted_quantile(members, probability),
    )


def _weighted_quantile(members: list[Floats], probability: float) -> float:
    """Smallest size that is not exceeded with the probability, at a time drawn at random of a member so drawn."""
    sizes = np.concatenate(members)
    order = np.argsort(sizes, kind="stable")
    weights = np.concatenate([np.full(len(row), 1.0 / len(row)) for row in members])[order]
    shares = np.cumsum(weights) / len(members)
    # A share that equals the probability but for rounding holds.
    place = int(np.searchsorted(shares, probability * (1.0 - 1e-12)))
    return float(sizes[order][min(place, len(sizes) - 1)])


def error_budget(
    error: Floats, windows: BudgetWindows, probability: float, confidence: float = 0.95, independent: bool = True
) -> Mapping[str, BudgetLine]:
    """Budget line of each of `INDICES` of a vector error (runs, ticks, k), in its unit."""
    return {
        name: budget_line(sizes, probability, confidence, independent)
        for name, sizes in error_indices(error, windows).items()
    }
