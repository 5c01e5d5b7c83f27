"""Probability distributions of single dispersed numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import scipy


@runtime_checkable
class Distribution(Protocol):
    """Probability distribution of one number, as those of `scipy.stats`."""

    def cdf(self, x: np.ndarray) -> np.ndarray:
        """Probability of at most `x` (n,)."""
        ...

    def ppf(self, q: np.ndarray) -> np.ndarray:
        """Quantiles: the least numbers with probabilities `q` (n,) in (0, 1) of at most them."""
        ...

    def mean(self) -> float:
        """Mean."""
        ...

    def std(self) -> float:
        """Standard deviation."""
        ...


@dataclass(frozen=True)
class DiscreteDistribution:
    """Discrete distribution over distinct `values` in ascending order, with their `probabilities`."""

    values: np.ndarray
    probabilities: np.ndarray

    def cdf(self, x: np.ndarray) -> np.ndarray:
        """Probability of at most `x` (n,)."""
        return np.concatenate([[0.0], np.cumsum(self.probabilities)])[np.searchsorted(self.values, x, side="right")]

    def ppf(self, q: np.ndarray) -> np.ndarray:
        """Quantiles: the least values with probabilities `q` (n,) in (0, 1) of at most them."""
        # Without the last sum, which rounding may leave below 1.
        return self.values[np.searchsorted(np.cumsum(self.probabilities)[:-1], q, side="left")]

    def mean(self) -> float:
        """Mean."""
        return float(self.probabilities @ self.values)

    def std(self) -> float:
        """Standard deviation."""
        return float(np.sqrt(self.probabilities @ np.square(self.values - self.mean())))


def discrete_distribution(listed: np.ndarray) -> DiscreteDistribution:
    """Distribution of one of the `listed` numbers (n,), which may repeat, with equal probability."""
    values, counts = np.unique(listed, return_counts=True)
    return DiscreteDistribution(values, counts / len(listed))


def normal_distributions(means: np.ndarray, sigma: float | Sequence[float] | np.ndarray) -> list[Distribution | None]:
    """Normal distributions with `means` (n,) and `sigma`, one number or (n,); None for constants and unknown means."""
    sigmas = np.broadcast_to(np.asarray(sigma, dtype=np.float64), means.shape)
    return [
        scipy.stats.norm(mean, one) if one > 0.0 and np.isfinite(mean) else None
        for mean, one in zip(means, sigmas, strict=True)
    ]
