"""Consistency of a filter with the errors that it really makes: NEES, NIS, whiteness of innovations, coverage.

Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import erf
from scipy.stats import chi2

from rpojax.analysis.statistics.multiple_testing import Z_95


def nees(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Normalised estimation error squared e' P^-1 e (...) of errors (..., n) with covariances (..., n, n)."""
    return np.asarray(np.sum(errors * np.linalg.solve(covariances, errors[..., None])[..., 0], axis=-1))


def mean_nees_interval(components: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval that holds the mean NEES of `components` errors over `runs` runs of a consistent filter."""
    tail = (1.0 - confidence) / 2.0
    low, high = chi2.ppf([tail, 1.0 - tail], components * runs) / runs
    return float(low), float(high)


def nis_interval(components: int, updates: int = 1, confidence: float = 0.95) -> tuple[float, float]:
    """Interval that holds the mean over `updates` independent updates of the normalised innovation squared."""
    return mean_nees_interval(components, updates, confidence)


def chi_square_gate(components: int, probability: float) -> float:
    """Normalised innovation squared below which a good measurement of `components` lies with that probability."""
    return float(chi2.ppf(probability, components))


def whiteness_bound(updates: int) -> float:
    """Size below which the autocorrelation of `updates` white innovations lies in 95 % of the cases."""
    return Z_95 / math.sqrt(updates)


def coverage_per_axis(sigmas: float) -> float:
    """Probability that a normal error lies within so many of its sigmas."""
    return float(erf(sigmas / math.sqrt(2.0)))


def coverage_of_ellipsoid(sigmas: float, dimensions: int) -> float:
    """Probability that a normal error vector lies within its ellipsoid of so many sigmas."""
    return float(chi2.cdf(sigmas**2, dimensions))


def radius_of_ellipsoid(probability: float, dimensions: int) -> float:
    """Sigmas of the ellipsoid that holds a normal error vector with that probability.

    For equal sigmas, one half and two or three dimensions it is the circular or spherical error probable over sigma.
    """
    return math.sqrt(chi2.ppf(probability, dimensions))


@dataclass(frozen=True)
class InnovationSquared:
    """Normalised innovation squared against chi-square bounds.

    Attributes:
        components: of one innovation
        mean: over all updates of all runs; `components` is consistent, more is too sure of itself
        interval: 95 % for that mean
        per_run: (runs,) mean over the updates of a run, NaN without any
        share_outside: of the runs whose mean is outside of its own 95 % interval; 0.05 is consistent
    """

    components: int
    mean: float
    interval: tuple[float, float]
    per_run: np.ndarray
    share_outside: float


def innovation_squared(innovations: np.ndarray) -> InnovationSquared:
    """Test of the size of normalised innovations (runs, ticks, components), NaN at ticks without an update."""
    components = innovations.shape[2]
    squares = np.sum(np.square(innovations), axis=2)
    updates = np.isfinite(squares).sum(axis=1)
    sums, total = np.nansum(squares, axis=1), int(updates.sum())
    some = updates > 0
    per_run = np.full(len(updates), np.nan)
    per_run[some] = sums[some] / updates[some]
    low, high = chi2.ppf([[0.025], [0.975]], components * updates[some]) / updates[some]
    return InnovationSquared(
        components=components,
        mean=float(sums.sum() / total) if total else math.nan,
        interval=nis_interval(components, total) if total else (math.nan, math.nan),
        per_run=per_run,
        share_outside=_share((per_run[some] < low) | (per_run[some] > high)),
    )


@dataclass(frozen=True)
class WhitenessTest:
    """Autocorrelation of innovations from one update to the next.

    Attributes:
        autocorrelation: (runs,) -1 to 1, 0 for white ones; NaN without two updates in a row
        bound: (runs,) 95 % bound of its size for white innovations
        share_outside: of the runs beyond their bound; 0.05 is consistent
    """

    autocorrelation: np.ndarray
    bound: np.ndarray
    fraction_outside: float


def whiteness_test(innovations: np.ndarray) -> WhitenessTest:
    """Test of independence of normalised innovations (runs, ticks, components), NaN at ticks without an update.

    Only updates at successive ticks count; components are taken together, as they are normalised.
    """
    before, after = innovations[:, :-1], innovations[:, 1:]
    both = np.all(np.isfinite(before) & np.isfinite(after), axis=2)
    before, after = (np.where(both[:, :, None], values, 0.0) for values in (before, after))
    numbers = both.sum(axis=1) * innovations.shape[2]
    power = np.sqrt(np.sum(before**2, axis=(1, 2)) * np.sum(after**2, axis=(1, 2)))
    some = power > 0.0
    autocorrelation, bound = np.full((2, len(innovations)), np.nan)
    autocorrelation[some] = np.sum(before * after, axis=(1, 2))[some] / power[some]
    bound[some] = Z_95 / np.sqrt(numbers[some])
    return WhitenessTest(autocorrelation, bound, _share(np.abs(autocorrelation[some]) > bound[some]))


@dataclass(frozen=True)
class AverageNees:
    """Average over runs of the normalised estimation error squared, against chi-square bounds.

    Attributes:
        components: of the error
        mean: (ticks,) average over the runs, NaN without any; `components` is consistent, more is too sure of itself
        low: (ticks,) of its 95 % interval
        high: (ticks,) of its 95 % interval
        share_above: of the ticks whose average is above the interval: too sure
        share_below: of the ticks whose average is below it: too modest
    """

    components: int
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray
    fraction_above: float
    fraction_below: float


def average_nees(values: np.ndarray, components: int) -> AverageNees:
    """Average NEES over runs of `values` (runs, ticks), NaN where a run has none."""
    runs = np.isfinite(values).sum(axis=0)
    some = runs > 0
    mean, low, high = np.full((3, values.shape[1]), np.nan)
    mean[some] = np.nansum(values, axis=0)[some] / runs[some]
    low[some], high[some] = chi2.ppf([[0.025], [0.975]], components * runs[some]) / runs[some]
    return AverageNees(components, mean, low, high, _share(mean[some] > high[some]), _share(mean[some] < low[some]))


@dataclass(frozen=True)
class Coverage:
    """Share of errors within some sigmas, over all runs.

    Attributes:
        sigmas: how many
        share: of the errors within them, mean over the runs
        expected: share for normal errors of the sigma that the filter believes
        interval: 95 % of `share`, from the spread between runs: errors within a run depend on each other
    """

    sigmas: float
    fraction: float
    expected: float
    interval: tuple[float, float]


def coverage(ratios: np.ndarray, sigmas: float) -> Coverage:
    """Coverage of scalar errors over their sigma `ratios` (runs, ...), NaN where there is none."""
    rows = np.abs(ratios.reshape(len(ratios), -1))
    numbers = np.isfinite(rows).sum(axis=1)
    shares = (rows <= sigmas).sum(axis=1)[numbers > 0] / numbers[numbers > 0]
    share = float(shares.mean()) if len(shares) else math.nan
    spread = Z_95 * float(shares.std(ddof=1)) / math.sqrt(len(shares)) if len(shares) > 1 else math.nan
    return Coverage(sigmas, share, coverage_per_axis(sigmas), (share - spread, share + spread))


def _share(flags: np.ndarray) -> float:
    return float(flags.mean()) if len(flags) else math.nan
