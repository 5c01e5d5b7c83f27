"""The most likely point beyond a limit, by derivatives, in a space of independent standard normal numbers.

First-order reliability: of all points where the margin to the limit is used up, the one nearest to the origin is the
most likely (Hasofer and Lind, 1974), and steps to the foot of the linearised limit lead to it (Rackwitz and Fiessler,
Comput. Struct. 9, 1978). Derivatives of flights mislead where an event is close. So every step is a fan of points that
are tried, what was met beyond the limit is never lost, and several searches start where random points come closest.
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
    SearchSettings,
)

_WIDENING = (1.0, 1.1, 1.2)
"""Random points of each further round lie so much farther out, up to the last of these factors."""
_LINE_SEARCH_ROUNDS, _LINE_SEARCH_POINTS = 4, 8
"""Shots along the line through what was tried: so many times, and so many at a time."""
_DEPTH = 0.85
"""Share of the reach that shots go along the slope, at most; the rest is left to all other numbers."""
_SMALLEST_PACE = 0.25
_WORTH_A_STEP = 0.01
"""Share of the distance, or of the margin, that a step must gain; else the next one is shorter."""


def find_design_point(limit_state: LimitState, dimension: int, settings: SearchSettings, seed: int) -> SearchResult:
    """The point beyond a `limit` on `count` normal numbers that is nearest to the origin; `seed` draws the starts."""
    book = EvaluationLog(limit_state, settings)
    rng = np.random.default_rng([seed, 0x5EED])
    try:
        # Where no search gets beyond the limit new random points are tried until all is spent.
        for number in itertools.count():
            fronts = _screen(book, rng, dimension, number)
            while fronts and not (book.nearest_violation is not None and book.nearest_violation.distance == 0.0):
                fronts = _advance(book, fronts)
            if book.nearest_violation is not None:
                break
        book.evaluate_gradient_at_nearest()
    except BudgetExceededError:
        pass
    return book.result()


@dataclass(frozen=True)
class _Front:
    """Where one search is: inside the limit it makes for it, beyond it it makes for the origin."""

    lane: int
    numbers: np.ndarray
    margin: float
    gradient: np.ndarray | None = None
    pace: float = 1.0


def _screen(book: EvaluationLog, rng: np.random.Generator, count: int, number: int) -> list[_Front]:
    """Random points, each on its own lane, the first one of all the origin, and shots; the best lanes are fronts."""
    size = book.settings.screening_points
    points = _within(
        _WIDENING[min(number, len(_WIDENING) - 1)] * rng.normal(size=(size, count)), book.settings.max_distance
    )
    if number == 0:
        points[0] = 0.0
    lanes = number * size + np.arange(size)
    margins = book.margins(points, lanes)
    points, lanes, margins = _shoot(book, rng, points, lanes, margins)
    best = _fronts(points, lanes, margins)[: book.settings.starts]
    return [_Front(int(lanes[row]), points[row], float(margins[row])) for row in best]


def _fronts(points: np.ndarray, lanes: np.ndarray, margins: np.ndarray) -> np.ndarray:
    """Rows of points to go on from, one a lane: the nearest one beyond the limit, then what is closest inside of it."""
    distances = np.linalg.norm(points, axis=1)
    beyond = np.flatnonzero(margins <= 0.0)
    inside = np.flatnonzero(margins > 0.0)
    order = np.concatenate(
        [beyond[np.argsort(distances[beyond])][:1], inside[np.argsort(margins[inside], kind="stable")]]
    )
    _, first = np.unique(lanes[order], return_index=True)
    return order[np.sort(first)]


def _shoot(
    book: EvaluationLog, rng: np.random.Generator, points: np.ndarray, lanes: np.ndarray, margins: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, k), lanes and margins with those of shots along the slope of the line through all points so far.

    Over random points that slope is the mean of all derivatives (Stein's identity), ripples smoothed out, and it needs
    no derivative. Shots end with the first one beyond the limit, or where a volley comes no closer.
    """
    own, closest = lanes[np.argsort(margins, kind="stable")], math.inf
    for _ in range(_LINE_SEARCH_ROUNDS):
        if margins.min() <= 0.0 or margins.min() >= closest:
            break
        closest = margins.min()
        slope, ahead = _line(points, margins)
        if not slope.any():
            break
        book.regression_gradient = slope
        down = -slope / np.linalg.norm(slope)
        depth = np.clip(ahead, 0.5 * _DEPTH * book.settings.max_distance, _DEPTH * book.settings.max_distance)
        across = rng.normal(size=(_LINE_SEARCH_POINTS, points.shape[1]))
        across -= np.outer(across @ down, down)
        room = math.sqrt(book.settings.max_distance**2 - depth**2)
        shots = depth * down + _within(across, room)
        on = np.resize(own, _LINE_SEARCH_POINTS)
        found = book.margins(shots, on)
        points, lanes = np.concatenate([points, shots]), np.concatenate([lanes, on])
        margins = np.concatenate([margins, found])
    return points, lanes, margins


def _line(points: np.ndarray, margins: np.ndarray) -> tuple[np.ndarray, float]:
    """Slope (k,) of the straight line through points (n, k), drawn in as fewer points than numbers ask for, and how
    far from the origin it meets the limit."""
    middle, mean = points.mean(axis=0), margins.mean()
    off = points - middle
    square = off.T @ off + points.shape[1] * np.eye(points.shape[1])
    slope = np.linalg.solve(square, off.T @ (margins - mean))
    size = float(np.linalg.norm(slope))
    return slope, float(mean - slope @ middle) / size if size > 0.0 else 0.0


def _advance(book: EvaluationLog, fronts: list[_Front]) -> list[_Front]:
    """Every front one step on; those that gain nothing any more are left out."""
    fronts = _with_gradients(book, fronts)
    trend = book.mean_gradient()
    fans = [_fan(front, trend, book.regression_gradient, book.settings.max_distance) for front in fronts]
    points = np.concatenate(fans)
    lanes = np.repeat([front.lane for front in fronts], [len(fan) for fan in fans])
    margins = np.split(book.margins(points, lanes), np.cumsum([len(fan) for fan in fans])[:-1])
    moved = [_best(front, fan, margin) for front, fan, margin in zip(fronts, fans, margins, strict=True)]
    return [front for front in moved if front is not None]


def _with_gradients(book: EvaluationLog, fronts: list[_Front]) -> list[_Front]:
    """Fronts with their gradients; one that did not move has its own still."""
    moved = [front for front in fronts if front.gradient is None]
    if not moved:
        return fronts
    found = iter(book.gradients(np.stack([one.numbers for one in moved]), np.array([one.lane for one in moved])))
    return [replace(front, gradient=next(found)) if front.gradient is None else front for front in fronts]


def _fan(front: _Front, trend: np.ndarray | None, line: np.ndarray | None, reach: float) -> np.ndarray:
    """Points (n, k) to try next, from a front with its gradient, the trend of all gradients and the line of shots."""
    z = front.numbers
    slopes = [slope for slope in (front.gradient, trend) if slope is not None and _is_told(slope)]
    if front.margin <= 0.0:
        tried = [(1.0 - front.pace * share) * z for share in (0.05, 0.15, 0.3, 0.5)]
        # What lies across the slope is mostly chance, and most of the distance.
        for slope in [*slopes, line] if line is not None else slopes:
            along = (slope @ z) / (slope @ slope) * slope
            tried += [along + (1.0 - front.pace * share) * (z - along) for share in (0.5, 1.0)]
    elif slopes:
        tried = []
    else:
        tried = [factor * z for factor in (-1.0, 0.8, 1.1, 1.25)]
    if np.isfinite(front.margin):
        tried += [point for slope in slopes for point in _steps(front, slope, reach)]
    return np.stack([_within(point, reach) for point in tried])


def _is_told(slope: np.ndarray) -> bool:
    return bool(np.isfinite(slope).all() and np.any(slope != 0.0))


def _steps(front: _Front, slope: np.ndarray, reach: float) -> list[np.ndarray]:
    """Points on the way to the limit, were it as far as `slope` (k,) says."""
    z, size = front.numbers, float(np.linalg.norm(slope))
    down = -slope / size
    foot = np.clip((front.margin - slope @ z) / size, 0.0, reach) * down
    if front.margin <= 0.0:
        on_the_way = [z + front.pace * share * (foot - z) for share in (0.4, 1.0)]
        return [*on_the_way, *(1.07 * step for step in on_the_way)]
    straight = front.pace * min(front.margin / size, reach) * down
    on_the_way = [z + front.pace * share * (foot - z) for share in (0.5, 1.0)]
    return [z + 1.3 * straight, z + 2.5 * straight, *on_the_way, 1.2 * foot]


def _best(front: _Front, fan: np.ndarray, margins: np.ndarray) -> _Front | None:
    """The front at the best point of its fan; with shorter steps where that gains little, None where it gains nothing
    with the shortest."""
    beyond = margins <= 0.0
    distances = np.linalg.norm(fan, axis=1)
    row = int(np.argmin(np.where(beyond, distances, np.inf)) if beyond.any() else np.argmin(margins))
    there = _Front(front.lane, fan[row], float(margins[row]), pace=front.pace)
    if front.margin <= 0.0:
        gained = beyond.any() and distances[row] < (1.0 - _WORTH_A_STEP) * np.linalg.norm(front.numbers)
    else:
        gained = margins[row] < (1.0 - _WORTH_A_STEP) * front.margin
    if gained:
        return there
    if front.pace / 2.0 < _SMALLEST_PACE:
        return None
    return replace(front, pace=front.pace / 2.0)


def _within(points: np.ndarray, reach: float) -> np.ndarray:
    """Points (..., k), those farther out than `reach` drawn in to it."""
    size = np.linalg.norm(points, axis=-1, keepdims=True)
    return points * np.minimum(1.0, reach / np.maximum(size, 1e-300))
