"""First-order reliability method (FORM): search for the design point, the most likely point beyond a limit.

In a space of independent standard normal numbers the violation nearest to the origin is the most likely one (Hasofer
and Lind, 1974), and steps to the foot of the linearised limit lead to it (Rackwitz and Fiessler, Comput. Struct. 9,
1978). Derivatives of runs mislead next to an event. So each step evaluates several candidate points, every violation
met is kept, and several searches start where random points come closest.
"""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from rpojax.analysis.reliability.evaluation_log import (
    BudgetExceededError,
    EvaluationLog,
    LimitState,
    SearchResult,
)
from rpojax.analysis.reliability.search_settings import SearchSettings

_SCREENING_SCALES = (1.0, 1.1, 1.2)
"""Scales of the random points of successive screening rounds; the last one is kept."""
_LINE_SEARCH_ROUNDS, _LINE_SEARCH_POINTS = 4, 8
"""Line searches along the regression gradient: how often, and how many points each."""
_LINE_SEARCH_DEPTH = 0.85
"""Greatest distance along the gradient over the maximum distance; the rest is left to all other directions."""
_MIN_STEP_SCALE = 0.25
_MIN_IMPROVEMENT = 0.01
"""Fraction of the distance, or of the margin, that a step must gain; otherwise the next one is shorter."""


def find_design_point(limit_state: LimitState, dimension: int, settings: SearchSettings, seed: int) -> SearchResult:
    """Violation nearest to the origin in `dimension` standard normal numbers; `seed` draws the starts."""
    log = EvaluationLog(limit_state, settings)
    rng = np.random.default_rng([seed, 0x5EED])
    try:
        # While there is no violation, new random points are screened until the budget is spent.
        for number in itertools.count():
            searches = _screen_random_points(log, rng, dimension, number)
            try:
                while searches and not (log.nearest_violation is not None and log.nearest_violation.distance == 0.0):
                    searches = _step_searches(log, searches)
            except BudgetExceededError:
                # What is left may be too little for gradients and still enough for many runs.
                if log.nearest_violation is not None:
                    raise
            if log.nearest_violation is not None:
                break
        log.evaluate_gradient_at_nearest()
    except BudgetExceededError:
        pass
    return log.result()


@dataclass(frozen=True)
class _SearchState:
    """State of one search: inside the limit it steps towards it, beyond it towards the origin."""

    replicate: int
    z: np.ndarray
    margin: float
    gradient: np.ndarray | None = None
    step_scale: float = 1.0


def _screen_random_points(
    log: EvaluationLog, rng: np.random.Generator, dimension: int, number: int
) -> list[_SearchState]:
    """Searches from the best of random points, each in its own replicate, the very first one at the origin."""
    size = log.settings.screening_points
    scale = _SCREENING_SCALES[min(number, len(_SCREENING_SCALES) - 1)]
    points = _clip_distance(scale * rng.normal(size=(size, dimension)), log.settings.max_distance)
    if number == 0:
        points[0] = 0.0
    replicates = number * size + np.arange(size)
    margins = log.margins(points, replicates)
    points, replicates, margins = _line_search(log, rng, points, replicates, margins)
    best = _starting_rows(points, replicates, margins)[: log.settings.starts]
    return [_SearchState(int(replicates[row]), points[row], float(margins[row])) for row in best]


def _starting_rows(points: np.ndarray, replicates: np.ndarray, margins: np.ndarray) -> np.ndarray:
    """Rows of points to start from, one a replicate: the nearest violation, then the smallest margins inside."""
    distances = np.linalg.norm(points, axis=1)
    beyond = np.flatnonzero(margins <= 0.0)
    inside = np.flatnonzero(margins > 0.0)
    order = np.concatenate(
        [beyond[np.argsort(distances[beyond])][:1], inside[np.argsort(margins[inside], kind="stable")]]
    )
    _, first = np.unique(replicates[order], return_index=True)
    return order[np.sort(first)]


def _line_search(
    log: EvaluationLog, rng: np.random.Generator, points: np.ndarray, replicates: np.ndarray, margins: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, k), replicates and margins with those of line searches along the gradient of a linear regression.

    Over random points the regression gradient is the mean of all derivatives (Stein's identity), ripples smoothed out,
    and it needs no derivative. It ends with the first violation, or where a round comes no closer.
    """
    by_margin, smallest = replicates[np.argsort(margins, kind="stable")], math.inf
    for _ in range(_LINE_SEARCH_ROUNDS):
        if margins.min() <= 0.0 or margins.min() >= smallest:
            break
        smallest = margins.min()
        gradient, distance = _linear_regression(points, margins)
        if not gradient.any():
            break
        log.regression_gradient = gradient
        candidates = _line_search_points(rng, gradient, distance, log.settings.max_distance)
        used = np.resize(by_margin, _LINE_SEARCH_POINTS)
        found = log.margins(candidates, used)
        points, replicates = np.concatenate([points, candidates]), np.concatenate([replicates, used])
        margins = np.concatenate([margins, found])
    return points, replicates, margins


def _line_search_points(
    rng: np.random.Generator, gradient: np.ndarray, distance: float, max_distance: float
) -> np.ndarray:
    """Points (n, k) at the linearised limit along the gradient (k,), random in all other directions."""
    down = -gradient / np.linalg.norm(gradient)
    depth = np.clip(distance, 0.5 * _LINE_SEARCH_DEPTH * max_distance, _LINE_SEARCH_DEPTH * max_distance)
    across = rng.normal(size=(_LINE_SEARCH_POINTS, len(gradient)))
    across -= np.outer(across @ down, down)
    room = math.sqrt(max_distance**2 - depth**2)
    return depth * down + _clip_distance(across, room)


def _linear_regression(points: np.ndarray, margins: np.ndarray) -> tuple[np.ndarray, float]:
    """Ridge regression of margins (n,) on points (n, k): gradient (k,), and distance from the origin to the limit."""
    middle, mean = points.mean(axis=0), margins.mean()
    centred = points - middle
    square = centred.T @ centred + points.shape[1] * np.eye(points.shape[1])
    gradient = np.linalg.solve(square, centred.T @ (margins - mean))
    size = float(np.linalg.norm(gradient))
    return gradient, float(mean - gradient @ middle) / size if size > 0.0 else 0.0


def _step_searches(log: EvaluationLog, searches: list[_SearchState]) -> list[_SearchState]:
    """Advances every search by one step; leaves out searches that no longer improve."""
    searches = _with_gradients(log, searches)
    mean_gradient = log.mean_gradient()
    candidates = [
        _candidate_points(search, mean_gradient, log.regression_gradient, log.settings.max_distance)
        for search in searches
    ]
    points = np.concatenate(candidates)
    replicates = np.repeat([search.replicate for search in searches], [len(candidate) for candidate in candidates])
    margins = np.split(log.margins(points, replicates), np.cumsum([len(each) for each in candidates])[:-1])
    moved = [_best_candidate(*each) for each in zip(searches, candidates, margins, strict=True)]
    return [search for search in moved if search is not None]


def _with_gradients(log: EvaluationLog, searches: list[_SearchState]) -> list[_SearchState]:
    """Searches with their gradients; one that did not move keeps its own."""
    moved = [search for search in searches if search.gradient is None]
    if not moved:
        return searches
    found = iter(log.gradients(np.stack([one.z for one in moved]), np.array([one.replicate for one in moved])))
    return [replace(search, gradient=next(found)) if search.gradient is None else search for search in searches]


def _candidate_points(
    search: _SearchState, mean_gradient: np.ndarray | None, regression: np.ndarray | None, max_distance: float
) -> np.ndarray:
    """Points (n, k) to evaluate next, from a search's own gradient, the mean gradient and the regression gradient."""
    z = search.z
    known = [gradient for gradient in (search.gradient, mean_gradient) if gradient is not None and _is_usable(gradient)]
    if search.margin <= 0.0:
        candidates = [(1.0 - search.step_scale * fraction) * z for fraction in (0.05, 0.15, 0.3, 0.5)]
        # What lies across the gradient is mostly noise, and most of the distance.
        for gradient in [*known, regression] if regression is not None else known:
            along = (gradient @ z) / (gradient @ gradient) * gradient
            candidates += [along + (1.0 - search.step_scale * fraction) * (z - along) for fraction in (0.5, 1.0)]
    elif known:
        candidates = []
    else:
        candidates = [factor * z for factor in (-1.0, 0.8, 1.1, 1.25)]
    if np.isfinite(search.margin):
        candidates += [point for gradient in known for point in _linearised_steps(search, gradient, max_distance)]
    return np.stack([_clip_distance(point, max_distance) for point in candidates])


def _is_usable(gradient: np.ndarray) -> bool:
    return bool(np.isfinite(gradient).all() and np.any(gradient != 0.0))


def _linearised_steps(search: _SearchState, gradient: np.ndarray, max_distance: float) -> list[np.ndarray]:
    """Points on the way to the foot of the limit linearised by `gradient` (k,)."""
    z, size = search.z, float(np.linalg.norm(gradient))
    down = -gradient / size
    foot = np.clip((search.margin - gradient @ z) / size, 0.0, max_distance) * down
    if search.margin <= 0.0:
        on_the_way = [z + search.step_scale * fraction * (foot - z) for fraction in (0.4, 1.0)]
        return [*on_the_way, *(1.07 * step for step in on_the_way)]
    straight = search.step_scale * min(search.margin / size, max_distance) * down
    on_the_way = [z + search.step_scale * fraction * (foot - z) for fraction in (0.5, 1.0)]
    return [z + 1.3 * straight, z + 2.5 * straight, *on_the_way, 1.2 * foot]


def _best_candidate(search: _SearchState, candidates: np.ndarray, margins: np.ndarray) -> _SearchState | None:
    """The search at its best candidate; with shorter steps if that gains little, None if they are the shortest."""
    beyond = margins <= 0.0
    distances = np.linalg.norm(candidates, axis=1)
    row = int(np.argmin(np.where(beyond, distances, np.inf)) if beyond.any() else np.argmin(margins))
    if search.margin <= 0.0:
        gained = beyond.any() and distances[row] < (1.0 - _MIN_IMPROVEMENT) * np.linalg.norm(search.z)
    else:
        gained = margins[row] < (1.0 - _MIN_IMPROVEMENT) * search.margin
    if gained:
        return _SearchState(search.replicate, candidates[row], float(margins[row]), step_scale=search.step_scale)
    if search.step_scale / 2.0 < _MIN_STEP_SCALE:
        return None
    return replace(search, step_scale=search.step_scale / 2.0)


def _clip_distance(points: np.ndarray, max_distance: float) -> np.ndarray:
    """Points (..., k), those farther out than `max_distance` moved in to it."""
    size = np.linalg.norm(points, axis=-1, keepdims=True)
    return points * np.minimum(1.0, max_distance / np.maximum(size, 1e-300))
