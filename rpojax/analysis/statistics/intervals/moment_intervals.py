"""Confidence intervals of a mean (bootstrap) and of a standard deviation (chi-square)."""

import math

import numpy as np
from scipy.stats import bootstrap, chi2


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
