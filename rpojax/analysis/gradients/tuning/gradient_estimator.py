"""Gradient of the tuning objective: derivatives of runs where they are smooth, finite differences where they are not.

A run depends smoothly on the noises of its filter and the gains of its attitude control: there the gradient is the
derivative of the loop. The gate, the control law and the schedule act through decisions (a box refused, a burn inside
the dead band). Between two decisions the derivative of a run tells nothing of the next one, and its mean over runs has
so long a tail that hundreds of runs do not determine its sign. There the gradient is a difference of two batches of the
same runs, with a step so long that many decisions lie in between.
"""

import math
from dataclasses import dataclass
from typing import Final

import jax.numpy as jnp
import numpy as np

from rpojax.analysis.gradients.rollout_evaluator import FORWARD_MODE_MAX_INPUTS, RolloutEvaluator, RolloutResult
from rpojax.analysis.gradients.tuning.tuning_objective import Objective

CLIP_RATIO: Final = 10.0
"""Longest gradient of a run over the median of all that are not zero."""
DIFFERENCE_HALF_WIDTH: Final = 0.4
"""Step of the differences to either side, in coordinates: a third less and a half more of a number."""


@dataclass(frozen=True)
class GradientEstimate:
    """Metrics of a batch, and the gradient of the objective.

    Attributes:
        metrics: (runs, metrics)
        gradient: (k,) of the objective
        excluded_runs: runs without a finite gradient
        clipped_runs: runs whose gradient was clipped
    """

    metrics: np.ndarray
    gradient: np.ndarray
    excluded_runs: int
    clipped_runs: int


def differentiation_mode(nonsmooth: np.ndarray) -> str:
    """Name of the method for numbers of which (k,) flags tell those that act through decisions."""
    derivative = "forward" if len(nonsmooth) <= FORWARD_MODE_MAX_INPUTS else "reverse"
    if nonsmooth.all():
        return "differences"
    return f"{derivative} and differences" if nonsmooth.any() else derivative


def estimate_gradient(
    evaluator: RolloutEvaluator, objective: Objective, nonsmooth: np.ndarray, x: np.ndarray, keys: np.ndarray
) -> GradientEstimate:
    """Gradient of the objective at coordinates `x` (k,) over runs with random keys (runs, 2).

    `nonsmooth` (k,) flags the numbers that act through decisions. The gradient is not finite where no run has a finite
    one.
    """
    found, gradient, excluded, clipped = _pathwise_gradient(evaluator, objective, nonsmooth, x, keys)
    if nonsmooth.any():
        gradient[nonsmooth] = _finite_differences(evaluator, objective, nonsmooth, x, keys)
    return GradientEstimate(found.metrics, gradient, excluded, clipped)


def run_gradients(
    evaluator: RolloutEvaluator, objective: Objective, x: np.ndarray, keys: np.ndarray
) -> tuple[RolloutResult, np.ndarray]:
    """Metrics of runs at coordinates (k,), and the derivative (runs, k) of each run's contribution to the objective."""
    inputs = np.tile(x, (len(keys), 1))
    is_reverse = evaluator.input_count > FORWARD_MODE_MAX_INPUTS
    found = evaluator.gradient(inputs, keys) if is_reverse else evaluator.jacobian(inputs, keys)
    cotangents = np.asarray(objective.gradient(jnp.asarray(found.metrics), jnp.ones(len(keys))))[..., None]
    # What undefined metrics contribute is constant, whatever their derivatives.
    if found.jacobian is not None:
        return found, np.where(cotangents == 0.0, 0.0, cotangents * found.jacobian).sum(axis=1)
    assert found.gradient is not None
    return found, np.where((cotangents == 0.0).all(axis=1), 0.0, found.gradient)


def clipped_sum(gradients: np.ndarray) -> tuple[np.ndarray, int, int]:
    """Sum (k,) of the gradients (runs, k) of runs, and how many were excluded as not finite, and clipped.

    Next to a discrete event the derivative of a run may be enormous while that of the mean is not. Runs without any
    metric have no gradient, and do not shorten those of the others.
    """
    finite = np.isfinite(gradients).all(axis=1)
    kept = gradients[finite]
    if len(kept) == 0:
        return np.full(gradients.shape[1], math.nan), len(gradients), 0
    norms = np.linalg.norm(kept, axis=1)
    longest = CLIP_RATIO * np.median(norms[norms > 0.0]) if norms.any() else 0.0
    factors = np.where(norms > longest, longest / np.where(norms > 0.0, norms, 1.0), 1.0)
    total = (kept * factors[:, None]).sum(axis=0)
    return total * len(gradients) / len(kept), int((~finite).sum()), int((factors < 1.0).sum())


def _pathwise_gradient(
    evaluator: RolloutEvaluator, objective: Objective, nonsmooth: np.ndarray, x: np.ndarray, keys: np.ndarray
) -> tuple[RolloutResult, np.ndarray, int, int]:
    """Metrics, and the clipped sum (k,) of the derivatives of runs, where any number is smooth."""
    if nonsmooth.all():
        return evaluator.evaluate(np.tile(x, (len(keys), 1)), keys), np.zeros(len(x)), 0, 0
    found, gradients = run_gradients(evaluator, objective, x, keys)
    return found, *clipped_sum(np.where(nonsmooth, 0.0, gradients))


def _finite_differences(
    evaluator: RolloutEvaluator, objective: Objective, nonsmooth: np.ndarray, x: np.ndarray, keys: np.ndarray
) -> np.ndarray:
    """Central differences of the objective; a run that loses a metric on one side points away from that side."""
    differences = []
    for index in np.flatnonzero(nonsmooth):
        move = DIFFERENCE_HALF_WIDTH * np.eye(len(x))[index]
        sides = [evaluator.evaluate(np.tile(x + sign * move, (len(keys), 1)), keys).metrics for sign in (1.0, -1.0)]
        up, down = (objective(side)[0] for side in sides)
        differences.append((up - down) / (2.0 * DIFFERENCE_HALF_WIDTH))
    return np.array(differences)
