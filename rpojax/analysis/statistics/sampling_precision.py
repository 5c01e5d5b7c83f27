"""How precise an estimate from a number of runs is, and how many runs a precision takes."""

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
from scipy.stats import bootstrap, chi2, nct, norm, qmc

from rpojax.analysis.statistics.multiple_testing import Z_95

Plan = Literal["random", "latin_hypercube", "sobol"]


def mean_interval(
    values: np.ndarray, confidence: float = 0.95, resamples: int = 9999, seed: int = 0
) -> tuple[float, float, float]:
    """Interval of the mean of `values` (n,) by the bias-corrected accelerated bootstrap, and its standard error.

    Source: Efron, Journal of the American Statistical Association 82, 1987.
    """
    rng = np.random.default_rng(seed)
    found = bootstrap(
        (values,), np.mean, confidence_level=confidence, n_resamples=resamples, method="BCa", rng=rng, batch=500
    )
    low, high = found.confidence_interval
    return float(low), float(high), float(found.standard_error)


def deviation_interval(deviation: float, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of the standard deviation of a normal quantity, from the sample's `deviation` over `runs` runs."""
    tail = (1.0 - confidence) / 2.0
    high, low = chi2.ppf([tail, 1.0 - tail], runs - 1)
    return deviation * math.sqrt((runs - 1) / low), deviation * math.sqrt((runs - 1) / high)


def normal_tolerance_factor(quantile: float, confidence: float, runs: int) -> float:
    """Factor k for which mean + k standard deviations of a normal sample is above the quantile with that confidence."""
    root = math.sqrt(runs)
    return float(nct.ppf(confidence, runs - 1, norm.ppf(quantile) * root)) / root


def relative_error_of_rate(rate: float, runs: int) -> float:
    """Standard deviation of an observed rate of events as a share of the rate."""
    return math.sqrt((1.0 - rate) / (rate * runs))


def runs_for_relative_error(rate: float, relative_error: float) -> int:
    """Fewest runs in which the observed rate of events has that relative error, 1 sigma."""
    return _up((1.0 - rate) / (rate * relative_error**2))


def runs_for_half_width(rate: float, half_width: float) -> int:
    """Fewest runs whose 95 % interval of a rate of events has that half-width, by the normal approximation."""
    return _up(Z_95**2 * rate * (1.0 - rate) / half_width**2)


def _up(runs: float) -> int:
    """Next whole number, unless rounding alone made it more than whole."""
    nearest = round(runs)
    return nearest if math.isclose(runs, nearest, rel_tol=1e-12) else math.ceil(runs)


def effective_sample_size(weights: np.ndarray) -> float:
    """Number of equally weighted runs that are worth as much as runs with `weights` (n,) (Kish, 1965)."""
    return float(np.sum(weights) ** 2 / np.sum(np.square(weights)))


def deviation_of_mean(
    plan: Plan, function: Callable[[np.ndarray], np.ndarray], dimensions: int, runs: int, repeats: int, seed: int = 0
) -> float:
    """Standard deviation over `repeats` campaigns of the mean of `function` over `runs` points of a sampling plan.

    `function` maps points (runs, dimensions) of the unit cube to values (runs,). For a Sobol plan, which is scrambled
    anew in each repeat, `runs` should be a power of two.
    """
    rng = np.random.default_rng(seed)
    return float(np.std([np.mean(function(_points(plan, dimensions, runs, rng))) for _ in range(repeats)], ddof=1))


def _points(plan: Plan, dimensions: int, runs: int, rng: np.random.Generator) -> np.ndarray:
    if plan == "random":
        return rng.random((runs, dimensions))
    if plan == "latin_hypercube":
        return qmc.LatinHypercube(dimensions, rng=rng).random(runs)
    return qmc.Sobol(dimensions, rng=rng).random(runs)
