"""Points that were tried against a limit: what they came to, and what they cost."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

_FEWEST_SLOPES = 3


@runtime_checkable
class LimitState(Protocol):
    """A margin that depends on normal numbers, and on a lane: another draw of everything else that is random."""

    @property
    def gradient_cost(self) -> float:
        """What a margin with its gradient costs, in margins; known once there has been one."""
        ...

    @property
    def batch_size(self) -> int:
        """Points that are worked out together, and cost as much if they are fewer."""
        ...

    def margins(self, points: np.ndarray, replicates: np.ndarray) -> np.ndarray:
        """Margins (n,) of points (n, k) on lanes (n,): positive inside the limit, minus infinity for lost runs."""
        ...

    def gradients(self, points: np.ndarray, replicates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Margins (n,) and their gradients (n, k)."""
        ...


@dataclass(frozen=True)
class SearchSettings:
    """How much is tried.

    Attributes:
        starts: searches at a time
        screened: random points, of which the best ones are the starts
        budget: what all may cost, in margins
        reach: largest distance from the origin that is tried
    """

    starts: int = 4
    screening_points: int = 16
    budget: float = 400.0
    max_distance: float = 6.0


@dataclass(frozen=True)
class EvaluatedPoint:
    """A point that was tried.

    Attributes:
        lane: that it was tried on
        numbers: (k,)
        margin: there
        spent: cost up to it, in margins
    """

    replicate: int
    z: np.ndarray
    margin: float
    cost: float

    @property
    def distance(self) -> float:
        """From the origin."""
        return float(np.linalg.norm(self.z))


@dataclass(frozen=True)
class SearchResult:
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

    nearest_violation: EvaluatedPoint | None
    first_violation: EvaluatedPoint | None
    smallest_margin: EvaluatedPoint
    alignment: float | None
    cost: float
    margin_evaluations: int
    gradient_evaluations: int


class BudgetExceededError(Exception):
    """The next step would cost more than there is."""


class EvaluationLog:
    """Everything that was tried, and what it cost."""

    def __init__(self, limit: LimitState, effort: SearchSettings) -> None:
        self.settings = effort
        self.nearest_violation: EvaluatedPoint | None = None
        self.regression_gradient: np.ndarray | None = None
        self._limit = limit
        self._first: EvaluatedPoint | None = None
        self._closest: EvaluatedPoint | None = None
        self._slope: np.ndarray | None = None
        self._slopes: list[np.ndarray] = []
        self._spent = 0.0
        self._margins = 0
        self._gradients = 0

    def margins(self, points: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        """Margins of points, entered and paid for."""
        self._pay(len(points), 1.0)
        found = self._limit.margins(points, lanes)
        self._margins += len(points)
        for point, lane, margin in zip(points, lanes, found, strict=True):
            self._enter(EvaluatedPoint(int(lane), point, float(margin), self._spent))
        return found

    def gradients(self, points: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        """Gradients of points whose margins are entered already, paid for."""
        self._pay(len(points), self._limit.gradient_cost)
        _, found = self._limit.gradients(points, lanes)
        self._gradients += len(points)
        self._slopes += [gradient for gradient in found if np.isfinite(gradient).all()]
        for point, lane, gradient in zip(points, lanes, found, strict=True):
            if (
                self.nearest_violation is not None
                and lane == self.nearest_violation.replicate
                and np.array_equal(point, self.nearest_violation.z)
            ):
                self._slope = gradient
        return found

    def mean_gradient(self) -> np.ndarray | None:
        """Mean (k,) of all gradients so far, each component drawn in to 0 as far as its scatter explains it; None for
        fewer than three.

        A flight depends on some numbers roughly, such as on the attitude of a tumbling target: there the gradients of
        different points point anywhere, and only where they agree does a long step keep what the gradient promises.
        """
        if len(self._slopes) < _FEWEST_SLOPES:
            return None
        return shrunk_mean(np.stack(self._slopes))

    def evaluate_gradient_at_nearest(self) -> None:
        """Works out the derivative at the nearest point, if it is not known."""
        if self.nearest_violation is not None and self._slope is None and self.nearest_violation.distance > 0.0:
            self.gradients(self.nearest_violation.z[None], np.array([self.nearest_violation.replicate]))

    def _alignment(self) -> float | None:
        if self.nearest_violation is None or self._slope is None:
            return None
        size = float(np.linalg.norm(self._slope)) * self.nearest_violation.distance
        return float(-self._slope @ self.nearest_violation.z / size) if np.isfinite(size) and size > 0.0 else None

    def result(self) -> SearchResult:
        """All in all."""
        assert self._closest is not None
        return SearchResult(
            nearest_violation=self.nearest_violation,
            first_violation=self._first,
            smallest_margin=self._closest,
            alignment=self._alignment(),
            cost=self._spent,
            margin_evaluations=self._margins,
            gradient_evaluations=self._gradients,
        )

    def _pay(self, points: int, cost: float) -> None:
        batch = self._limit.batch_size
        price = -(-points // batch) * batch * cost
        if self._closest is not None and self._spent + price > self.settings.budget:
            raise BudgetExceededError
        self._spent += price

    def _enter(self, point: EvaluatedPoint) -> None:
        if self._closest is None or point.margin < self._closest.margin:
            self._closest = point
        if point.margin <= 0.0:
            self._first = self._first or point
            if self.nearest_violation is None or point.distance < self.nearest_violation.distance:
                self.nearest_violation, self._slope = point, None


def shrunk_mean(gradients: np.ndarray) -> np.ndarray:
    """Mean (k,) over the rows of `slopes` (n, k), times the share of its square that its standard error does not
    explain."""
    mean, error = gradients.mean(axis=0), gradients.std(axis=0, ddof=1) / np.sqrt(len(gradients))
    square = mean**2
    return mean * square / np.maximum(square + error**2, 1e-300)
