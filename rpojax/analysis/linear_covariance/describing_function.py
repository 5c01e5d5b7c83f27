"""Statistical linearisation of a decision: the straight line that fits it best over what its input may be.

CADET (Gelb and Warren, "Direct statistical analysis of nonlinear systems: CADET", AIAA Journal 11, 1973): a normal
input through a nonlinearity is replaced by mean, gain and residual of least mean square error. The expectations are
means over a fixed set of quasi-random normal numbers.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc


@dataclass(frozen=True)
class StatisticalLinearisation:
    """A vector function of a normal vector, `f(u) = mean + gain (u - E u) + residual`.

    Attributes:
        mean: (m,) of f
        gain: (m, n)
        residual: (m, m) covariance of what the line leaves, uncorrelated with u
        inputs: (samples, n) the values of u that this comes from
        outputs: (samples, m) f there
    """

    mean: np.ndarray
    gain: np.ndarray
    residual: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray


def normal_points(dimension: int, power: int) -> np.ndarray:
    """(2**power, dimension) standard normal numbers that fill space evenly, with mean 0 and unit covariance."""
    points = ndtri(qmc.Sobol(dimension, scramble=True, rng=0).random_base2(power))
    points = points - points.mean(axis=0)
    root = np.linalg.cholesky(points.T @ points / len(points))
    return np.linalg.solve(root, points.T).T


def statistical_linearisation(
    function: Callable[[np.ndarray], np.ndarray], mean: np.ndarray, covariance: np.ndarray, points: np.ndarray
) -> StatisticalLinearisation:
    """Line through `function`, which maps (samples, n) to (samples, m), over a normal input at the `points` (s, n)."""
    values, vectors = np.linalg.eigh(covariance)
    sigma = np.sqrt(np.maximum(values, 0.0))
    inputs = mean + points * sigma @ vectors.T
    outputs = function(inputs)
    centre = outputs.mean(axis=0)
    slope = (outputs - centre).T @ points / len(points)
    left = outputs - centre - points @ slope.T
    # A direction in which the input does not vary has no say in the gain.
    inverse = np.where(sigma > 1e-12 * max(sigma.max(), 1e-300), 1.0 / np.maximum(sigma, 1e-300), 0.0)
    return StatisticalLinearisation(
        mean=centre,
        gain=slope * inverse @ vectors.T,
        residual=left.T @ left / len(points),
        inputs=inputs,
        outputs=outputs,
    )
