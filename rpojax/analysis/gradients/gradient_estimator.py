"""The gradient that a step of tuning follows.

A run depends smoothly on the noises of its filter and the gains of its attitude control: there the derivative of the
loop is the slope. The gate, the control law and the schedule act through decisions (a box refused, a burn inside the
dead band), and between two decisions a run's derivative says nothing of the next one: its mean over runs has so long
a tail that hundreds of runs do not tell its sign. There the slope is a difference of two batches of the same runs,
far enough apart that many decisions lie between them.
"""

import math
from dataclasses import dataclass
from typing import Final

import jax.numpy as jnp
import numpy as np

from rpojax.analysis.gradients.rollout_evaluator import FORWARD_MODE_MAX_INPUTS, RolloutEvaluator, RolloutResult
from rpojax.analysis.gradients.tuning_objective import Objective

CLIP_RATIO: Final = 10.0
"""A run whose gradient is longer than so many times the batch's median is shortened to that."""
DIFFERENCE_HALF_WIDTH: Final = 0.4
"""Differences are taken so far to either side, in coordinates: a third less and a half more of a number."""


@dataclass(frozen=True)
class GradientEstimate:
    """Figures of a batch, and what they say about where to go.

    Attributes:
        figures: (runs, figures)
        total: (k,) gradient of the objective
        left_out: runs without a finite gradient
        shortened: runs whose gradient was clipped
    """

    metrics: np.ndarray
    gradient: np.ndarray
    excluded_runs: int
    clipped_runs: int


def differentiation_mode(nonsmooth: np.ndarray) -> str:
    """How the gradient is made where (k,) flags tell the numbers that act through decisions."""
    derivative = "forward" if len(nonsmooth) <= FORWARD_MODE_MAX_INPUTS else "reverse"
    if nonsmooth.all():
        return "differences"
    return f"{derivative} and differences" if nonsmooth.any() else derivative


def estimate_gradient(
    evaluator: RolloutEvaluator, objective: Objective, nonsmooth: np.ndarray, x: np.ndarray, keys: np.ndarray
) -> GradientEstimate:
    """Gradient at coordinates (k,) of the objective of runs with keys (runs, 2).

    `decides` (k,) flags the numbers that act through decisions. Where not one run has a finite gradient the total is
    not finite.
    """
    found, total, left_out, shortened = _pathwise_gradient(evaluator, objective, nonsmooth, x, keys)
    if nonsmooth.any():
        total[nonsmooth] = _finite_differences(evaluator, objective, nonsmooth, x, keys, found.metrics)
    return GradientEstimate(found.metrics, total, left_out, shortened)


def run_gradients(
    evaluator: RolloutEvaluator, objective: Objective, x: np.ndarray, keys: np.ndarray
) -> tuple[RolloutResult, np.ndarray]:
    """Figures of runs at coordinates (k,), and the derivative (runs, k) of the objective's share of each run."""
    numbers = np.tile(x, (len(keys), 1))
    if evaluator.input_count > FORWARD_MODE_MAX_INPUTS:
        found = evaluator.gradient(numbers, keys)
        assert found.gradient is not None
        return found, found.gradient
    found = evaluator.jacobian(numbers, keys)
    assert found.jacobian is not None
    slope = objective.gradient(*map(jnp.asarray, (found.metrics, found.metrics, np.ones(len(keys)))))
    return found, np.einsum("rf,rfk->rk", np.asarray(slope), found.jacobian)


def clipped_sum(gradients: np.ndarray) -> tuple[np.ndarray, int, int]:
    """Sum (k,) of the gradients (runs, k) of runs, how many were left out as not finite, and how many shortened.

    The loop has discrete events, and next to one a run's derivative may be enormous while that of the mean is not.
    """
    finite = np.isfinite(gradients).all(axis=1)
    there = gradients[finite]
    if len(there) == 0:
        return np.full(gradients.shape[1], math.nan), len(gradients), 0
    norms = np.linalg.norm(there, axis=1)
    longest = CLIP_RATIO * np.median(norms)
    factors = np.where(norms > longest, longest / np.where(norms > 0.0, norms, 1.0), 1.0)
    total = (there * factors[:, None]).sum(axis=0)
    return total * len(gradients) / len(there), int((~finite).sum()), int((factors < 1.0).sum())


def _pathwise_gradient(
    flights: RolloutEvaluator, objective: Objective, decides: np.ndarray, x: np.ndarray, keys: np.ndarray
) -> tuple[RolloutResult, np.ndarray, int, int]:
    """Figures, and the sum (k,) of the derivatives of runs, where there are numbers that need them."""
    if decides.all():
        return flights.evaluate(np.tile(x, (len(keys), 1)), keys), np.zeros(len(x)), 0, 0
    found, gradients = run_gradients(flights, objective, x, keys)
    # A batch too large for the devices is flown in several, each with an objective of its own.
    smooth = np.where(decides, 0.0, gradients / -(-len(keys) // flights.batch_size))
    return found, *clipped_sum(smooth)


def _finite_differences(
    flights: RolloutEvaluator,
    objective: Objective,
    decides: np.ndarray,
    x: np.ndarray,
    keys: np.ndarray,
    figures: np.ndarray,
) -> np.ndarray:
    """Central differences of the objective over the runs that are finite on both sides."""
    slopes = []
    for index in np.flatnonzero(decides):
        move = DIFFERENCE_HALF_WIDTH * np.eye(len(x))[index]
        sides = [flights.evaluate(np.tile(x + sign * move, (len(keys), 1)), keys).metrics for sign in (1.0, -1.0)]
        lost = ~np.isfinite(np.concatenate([figures, *sides], axis=1)).all(axis=1, keepdims=True)
        up, down = (objective(np.where(lost, np.nan, side))[0] for side in sides)
        slopes.append((up - down) / (2.0 * DIFFERENCE_HALF_WIDTH))
    return np.array(slopes)
