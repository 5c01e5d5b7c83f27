"""The most likely point beyond a limit, by derivatives, in a space of independent standard normal numbers.

First-order reliability: of all points where the margin to the limit is used up, the one nearest to the origin is the
most likely (Hasofer and Lind, 1974), and steps to the foot of the linearised limit lead to it (Rackwitz and Fiessler,
Comput. Struct. 9, 1978). Derivatives of flights mislead where an event is close. So every step is a fan of points that
are tried, what was met beyond the limit is never lost, and several searches start where random points come closest.
"""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

_ROUNDS = 3
"""So many times new random points are tried where no search got beyond the limit."""
_WIDENING = 1.25
"""Random points of each further round lie so much farther out."""
_SMALLEST_PACE = 0.25
_WORTH_A_STEP = 0.01
"""Share of the distance, or of the margin, that a step must gain; else the next one is shorter."""


@runtime_checkable
class Limit(Protocol):
    """A margin that depends on normal numbers, and on a lane: another draw of everything else that is random."""

    @property
    def gradient_cost(self) -> float:
        """What a margin with its gradient costs, in margins; known once there has been one."""
        ...

    @property
    def batch(self) -> int:
        """Points that are worked out together, and cost as much if they are fewer."""
        ...

    def margins(self, points: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        """Margins (n,) of points (n, k) on lanes (n,): positive inside the limit, minus infinity for lost runs."""
        ...

    def gradients(self, points: np.ndarray, lanes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Margins (n,) and their gradients (n, k)."""
        ...


@dataclass(frozen=True)
class Effort:
    """How much is tried.

    Attributes:
        starts: searches at a time
        screened: random points, of which the best ones are the starts
        budget: what all may cost, in margins
        reach: largest distance from the origin that is tried
    """

    starts: int = 2
    screened: int = 16
    budget: float = 200.0
    reach: float = 6.0


@dataclass(frozen=True)
class Point:
    """A point that was tried.

    Attributes:
        lane: that it was tried on
        numbers: (k,)
        margin: there
        spent: cost up to it, in margins
    """

    lane: int
    numbers: np.ndarray
    margin: float
    spent: float

    @property
    def distance(self) -> float:
        """From the origin."""
        return float(np.linalg.norm(self.numbers))


@dataclass(frozen=True)
class Found:
    """What a search came to.

    Attributes:
        nearest: of the points beyond the limit; None without any
        first: point beyond the limit that was met; None without any
        closest: point with the least margin
        alignment: cosine of the angle from the nearest point to its own steepest descent, 1 at a design point; None
            without a derivative there
        spent: cost of all, in margins
        margins: that were worked out alone
        gradients: that were worked out
    """

    nearest: Point | None
    first: Point | None
    closest: Point
    alignment: float | None
    spent: float
    margins: int
    gradients: int


def search(limit: Limit, count: int, effort: Effort, seed: int) -> Found:
    """The point beyond a `limit` on `count` normal numbers that is nearest to the origin; `seed` draws the starts."""
    book = _Book(limit, effort)
    rng = np.random.default_rng([seed, 0x5EED])
    try:
        for number in range(_ROUNDS):
            fronts = _screen(book, rng, count, number)
            while fronts and not (book.nearest is not None and book.nearest.distance == 0.0):
                fronts = _advance(book, fronts)
            if book.nearest is not None:
                break
        book.align()
    except _SpentError:
        pass
    return book.found()


class _SpentError(Exception):
    """The next step would cost more than there is."""


class _Book:
    """Everything that was tried, and what it cost."""

    def __init__(self, limit: Limit, effort: Effort) -> None:
        self.effort = effort
        self.nearest: Point | None = None
        self._limit = limit
        self._first: Point | None = None
        self._closest: Point | None = None
        self._slope: np.ndarray | None = None
        self._spent = 0.0
        self._margins = 0
        self._gradients = 0

    def margins(self, points: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        """Margins of points, entered and paid for."""
        self._pay(len(points), 1.0)
        found = self._limit.margins(points, lanes)
        self._margins += len(points)
        for point, lane, margin in zip(points, lanes, found, strict=True):
            self._enter(Point(int(lane), point, float(margin), self._spent))
        return found

    def gradients(self, points: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        """Gradients of points whose margins are entered already, paid for."""
        self._pay(len(points), self._limit.gradient_cost)
        _, found = self._limit.gradients(points, lanes)
        self._gradients += len(points)
        for point, lane, gradient in zip(points, lanes, found, strict=True):
            if self.nearest is not None and lane == self.nearest.lane and np.array_equal(point, self.nearest.numbers):
                self._slope = gradient
        return found

    def align(self) -> None:
        """Works out the derivative at the nearest point, if it is not known."""
        if self.nearest is not None and self._slope is None and self.nearest.distance > 0.0:
            self.gradients(self.nearest.numbers[None], np.array([self.nearest.lane]))

    def _alignment(self) -> float | None:
        if self.nearest is None or self._slope is None:
            return None
        size = float(np.linalg.norm(self._slope)) * self.nearest.distance
        return float(-self._slope @ self.nearest.numbers / size) if np.isfinite(size) and size > 0.0 else None

    def found(self) -> Found:
        """All in all."""
        assert self._closest is not None
        return Found(
            nearest=self.nearest,
            first=self._first,
            closest=self._closest,
            alignment=self._alignment(),
            spent=self._spent,
            margins=self._margins,
            gradients=self._gradients,
        )

    def _pay(self, points: int, cost: float) -> None:
        batch = self._limit.batch
        price = -(-points // batch) * batch * cost
        if self._closest is not None and self._spent + price > self.effort.budget:
            raise _SpentError
        self._spent += price

    def _enter(self, point: Point) -> None:
        if self._closest is None or point.margin < self._closest.margin:
            self._closest = point
        if point.margin <= 0.0:
            self._first = self._first or point
            if self.nearest is None or point.distance < self.nearest.distance:
                self.nearest, self._slope = point, None


@dataclass(frozen=True)
class _Front:
    """Where one search is: inside the limit it makes for it, beyond it it makes for the origin."""

    lane: int
    numbers: np.ndarray
    margin: float
    gradient: np.ndarray | None = None
    pace: float = 1.0


def _screen(book: _Book, rng: np.random.Generator, count: int, number: int) -> list[_Front]:
    """Random points, each on its own lane, the first one of all the origin; the best ones are fronts."""
    size = book.effort.screened
    points = _within(_WIDENING**number * rng.normal(size=(size, count)), book.effort.reach)
    if number == 0:
        points[0] = 0.0
    lanes = number * size + np.arange(size)
    margins = book.margins(points, lanes)
    best = np.argsort(margins, kind="stable")[: book.effort.starts]
    return [_Front(int(lanes[row]), points[row], float(margins[row])) for row in best]


def _advance(book: _Book, fronts: list[_Front]) -> list[_Front]:
    """Every front one step on; those that gain nothing any more are left out."""
    fronts = _with_gradients(book, fronts)
    fans = [_fan(front, book.effort.reach) for front in fronts]
    points = np.concatenate(fans)
    lanes = np.repeat([front.lane for front in fronts], [len(fan) for fan in fans])
    margins = np.split(book.margins(points, lanes), np.cumsum([len(fan) for fan in fans])[:-1])
    moved = [_best(front, fan, margin) for front, fan, margin in zip(fronts, fans, margins, strict=True)]
    return [front for front in moved if front is not None]


def _with_gradients(book: _Book, fronts: list[_Front]) -> list[_Front]:
    """Fronts with their gradients; one that did not move has its own still."""
    moved = [front for front in fronts if front.gradient is None]
    if not moved:
        return fronts
    found = iter(book.gradients(np.stack([one.numbers for one in moved]), np.array([one.lane for one in moved])))
    return [replace(front, gradient=next(found)) if front.gradient is None else front for front in fronts]


def _fan(front: _Front, reach: float) -> np.ndarray:
    """Points (n, k) to try next, from a front with its gradient."""
    assert front.gradient is not None
    z, gradient, size = front.numbers, front.gradient, float(np.linalg.norm(front.gradient))
    told = np.isfinite(size) and size > 0.0 and np.isfinite(front.margin)
    if front.margin <= 0.0:
        shorter = [(1.0 - front.pace * share) * z for share in (0.05, 0.15, 0.3, 0.5)]
        if not told:
            return np.stack(shorter)
        foot = max(0.0, (front.margin - gradient @ z) / size) * -gradient / size
        steps = [z + front.pace * share * (foot - z) for share in (0.4, 1.0)]
        return np.stack([*shorter, *steps, *(1.07 * step for step in steps)])
    if not told:
        return np.stack([_within(-z, reach), *(_within(factor * z, reach) for factor in (0.8, 1.1, 1.25))])
    down = -gradient / size
    foot = np.clip((front.margin - gradient @ z) / size, 0.0, reach) * down
    straight = front.pace * min(front.margin / size, reach) * down
    on_the_way = [z + front.pace * share * (foot - z) for share in (0.5, 1.0)]
    tried = [z + 1.3 * straight, z + 2.5 * straight, *on_the_way, 1.2 * foot]
    return np.stack([_within(point, reach) for point in tried])


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
