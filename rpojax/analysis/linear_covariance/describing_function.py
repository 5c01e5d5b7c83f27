"""Describing function (statistical linearisation): the linear function of least mean square error over a normal input.

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
    """Linearisation of a vector function of a normal vector, `f(u) = mean + gain (u - E u) + residual`.

    Attributes:
        mean: (m,) of f
        gain: (m, n)
        residual: (m, m) covariance of the residual, uncorrelated with u
        inputs: (samples, n) sampled values of u
        outputs: (samples, m) f there
    """

    mean: np.ndarray
    gain: np.ndarray
    residual: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray


def normal_points(dimension: int, power: int) -> np.ndarray:
    """Quasi-random standard normal numbers (2**power, dimension), with mean 0 and unit covariance."""
    points = ndtri(qmc.Sobol(dimension, scramble=True, rng=0).random_base2(power))
    points = points - points.mean(axis=0)
    root = np.linalg.cholesky(points.T @ points / len(points))
    return np.linalg.solve(root, points.T).T


def statistical_linearisation(
    function: Callable[[np.ndarray], np.ndarray], mean: np.ndarray, covariance: np.ndarray, points: np.ndarray
) -> StatisticalLinearisation:
    """Linearises `function`, from (samples, n) to (samples, m), over a normal input at standard normal `points`."""
    values, vectors = np.linalg.eigh(covariance)
    sigma = np.sqrt(np.maximum(values, 0.0))
    inputs = mean + points * sigma @ vectors.T
    outputs = function(inputs)
    centre = outputs.mean(axis=0)
    cross_moment = (outputs - centre).T @ points / len(points)
    residual = outputs - centre - points @ cross_moment.T
    # A direction in which the input does not vary does not enter the gain.
    inverse = np.where(sigma > 1e-12 * max(sigma.max(), 1e-300), 1.0 / np.maximum(sigma, 1e-300), 0.0)
    return StatisticalLinearisation(
        mean=centre,
        gain=cross_moment * inverse @ vectors.T,
        residual=residual.T @ residual / len(points),
        inputs=inputs,
        outputs=outputs,
    )
