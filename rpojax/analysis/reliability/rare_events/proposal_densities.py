"""Densities from which importance sampling draws: Gaussians in a subspace, a radial law, and mixtures of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.special import gammaln, logsumexp

_LOG_2PI = float(np.log(2.0 * np.pi))


@runtime_checkable
class Density(Protocol):
    """A density of standard normal numbers."""

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Points (count, k)."""
        ...

    def log_density(self, x: np.ndarray) -> np.ndarray:
        """Logarithm (n,) of the density at points (n, k)."""
        ...


def log_nominal(x: np.ndarray) -> np.ndarray:
    """Logarithm (n,) of the standard normal density at points (n, k)."""
    return -0.5 * np.sum(x**2, axis=1) - 0.5 * x.shape[1] * _LOG_2PI


@dataclass(frozen=True)
class SubspaceGaussian:
    """Gaussian in a subspace, standard normal in all directions across it.

    Attributes:
        basis: (k, r) orthonormal directions
        mean: (r,) along them
        factor: (r, r) lower Cholesky factor of the covariance along them
    """

    basis: np.ndarray
    mean: np.ndarray
    factor: np.ndarray

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Points (count, k)."""
        x = rng.standard_normal((count, len(self.basis)))
        along = x @ self.basis
        return x + (self.mean + along @ self.factor.T - along) @ self.basis.T

    def log_density(self, x: np.ndarray) -> np.ndarray:
        """Logarithm (n,) of the density at points (n, k)."""
        along = x @ self.basis
        whitened = np.linalg.solve(self.factor, (along - self.mean).T)
        determinant = float(np.log(np.diag(self.factor)).sum())
        change = 0.5 * (np.sum(along**2, axis=1) - np.sum(whitened**2, axis=0)) - determinant
        return log_nominal(x) + change


@dataclass(frozen=True)
class RadialDensity:
    """All directions alike; the square of the radius has a gamma distribution.

    Attributes:
        dimension: k
        shape: of the gamma distribution
        scale: of it
    """

    dimension: int
    shape: float
    scale: float

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Points (count, k)."""
        directions = rng.standard_normal((count, self.dimension))
        radii = np.sqrt(rng.gamma(self.shape, self.scale, count))
        return directions * (radii / np.linalg.norm(directions, axis=1))[:, None]

    def log_density(self, x: np.ndarray) -> np.ndarray:
        """Logarithm (n,) of the density at points (n, k)."""
        squares = np.maximum(np.sum(x**2, axis=1), 1e-300)
        half = 0.5 * self.dimension
        of_square = (
            (self.shape - 1.0) * np.log(squares)
            - squares / self.scale
            - gammaln(self.shape)
            - self.shape * np.log(self.scale)
        )
        # Density of the square over the surface that its change sweeps: pi^(k/2) / Gamma(k/2) s^(k/2 - 1).
        return of_square - half * np.log(np.pi) + gammaln(half) - (half - 1.0) * np.log(squares)


@dataclass(frozen=True)
class Mixture:
    """Mixture of densities.

    Attributes:
        parts: densities
        weights: (parts,) positive, with sum 1
    """

    parts: Sequence[Density]
    weights: np.ndarray

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Points (count, k), of each part as many as its weight says, rounded at random."""
        ends = np.cumsum(self.weights) * count
        ends[-1] = count
        counts = np.diff(np.floor(np.concatenate([[0.0], ends]) + rng.random()).clip(0, count))
        counts[-1] += count - counts.sum()
        return np.concatenate([part.sample(rng, int(n)) for part, n in zip(self.parts, counts, strict=True)])

    def log_density(self, x: np.ndarray) -> np.ndarray:
        """Logarithm (n,) of the density at points (n, k)."""
        each = np.stack([part.log_density(x) for part in self.parts])
        return np.asarray(logsumexp(each + np.log(self.weights)[:, None], axis=0))

    def shares(self, x: np.ndarray) -> np.ndarray:
        """Probabilities (n, parts) that points came from each part."""
        each = np.stack([part.log_density(x) for part in self.parts]) + np.log(self.weights)[:, None]
        return np.exp(each - logsumexp(each, axis=0)).T


def mixture(parts: Sequence[tuple[float, Density]]) -> Mixture:
    """Mixture of weighted densities; a density that is a mixture itself adds its parts."""
    densities: list[Density] = []
    weights: list[float] = []
    for weight, part in parts:
        if isinstance(part, Mixture):
            densities += part.parts
            weights += (weight * part.weights).tolist()
        elif weight > 0.0:
            densities.append(part)
            weights.append(weight)
    total = np.asarray(weights)
    return Mixture(tuple(densities), total / total.sum())
