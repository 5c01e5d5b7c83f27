"""Log of the limit-state evaluations of a search: margins, gradients, their cost, and the nearest violation."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from rpojax.analysis.reliability.search_settings import SearchSettings
from rpojax.analysis.statistics.intervals import shrunk_mean

_MIN_GRADIENTS = 3


@runtime_checkable
class LimitState(Protocol):
    """Limit-state function: a margin of standard normal numbers z, and of a replicate of all other randomness."""

    @property
    def gradient_cost(self) -> float:
        """Cost of a margin with its gradient, in margins; known once there has been one."""
        ...

    @property
    def batch_size(self) -> int:
        """Points that are evaluated together, and cost as much if they are fewer."""
        ...

    def margins(self, points: np.ndarray, replicates: np.ndarray) -> np.ndarray:
        """Margins (n,) of points (n, k) in replicates (n,): positive inside the limit, minus infinity for failures."""
        ...

    def gradients(self, points: np.ndarray, replicates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Margins (n,) and their gradients (n, k)."""
        ...


@dataclass(frozen=True)
class EvaluatedPoint:
    """A point whose margin was evaluated.

    Attributes:
        replicate: in which it was evaluated
        z: (k,) standard normal numbers
        margin: there
        cost: total cost up to it, in margins
    """

    replicate: int
    z: np.ndarray
    margin: float
    cost: float

    @property
    def distance(self) -> float:
        """Distance from the origin [sigmas]."""
        return float(np.linalg.norm(self.z))


@dataclass(frozen=True)
class SearchResult:
    """Result of a search.

    Attributes:
        nearest_violation: point beyond the limit nearest to the origin; None if no point is beyond it
        first_violation: point beyond the limit that was met first; None if no point is beyond it
        smallest_margin: point with the least margin
        alignment: cosine of the angle between the nearest violation and its steepest descent, 1 at a design point; None
            without a derivative there
        cost: total, in margins
        margin_evaluations: margins that were evaluated alone
        gradient_evaluations: gradients that were evaluated
    """

    nearest_violation: EvaluatedPoint | None
    first_violation: EvaluatedPoint | None
    smallest_margin: EvaluatedPoint
    alignment: float | None
    cost: float
    margin_evaluations: int
    gradient_evaluations: int


class BudgetExceededError(Exception):
    """The next evaluation would exceed the budget."""


class EvaluationLog:
    """Evaluates a limit state, and keeps results and cost.

    Attributes:
        settings: effort of the search
        nearest_violation: so far
        regression_gradient: (k,) of the linear regression through all points; None before it is known
    """

    def __init__(self, limit_state: LimitState, settings: SearchSettings) -> None:
        self.settings = settings
        self.nearest_violation: EvaluatedPoint | None = None
        self.regression_gradient: np.ndarray | None = None
        self._limit_state = limit_state
        self._first_violation: EvaluatedPoint | None = None
        self._smallest_margin: EvaluatedPoint | None = None
        self._gradient_at_nearest: np.ndarray | None = None
        self._gradients: list[np.ndarray] = []
        self._cost = 0.0
        self._margin_evaluations = 0
        self._gradient_evaluations = 0

    def margins(self, points: np.ndarray, replicates: np.ndarray) -> np.ndarray:
        """Margins (n,) of points (n, k), recorded and charged."""
        self._charge(len(points), 1.0)
        found = self._limit_state.margins(points, replicates)
        self._margin_evaluations += len(points)
        for point, replicate, margin in zip(points, replicates, found, strict=True):
            self._record(EvaluatedPoint(int(replicate), point, float(margin), self._cost))
        return found

    def gradients(self, points: np.ndarray, replicates: np.ndarray) -> np.ndarray:
        """Gradients (n, k) at points (n, k) whose margins are recorded already, charged."""
        self._charge(len(points), self._limit_state.gradient_cost)
        _, found = self._limit_state.gradients(points, replicates)
        self._gradient_evaluations += len(points)
        self._gradients += [gradient for gradient in found if np.isfinite(gradient).all()]
        nearest = self.nearest_violation
        for point, replicate, gradient in zip(points, replicates, found, strict=True):
            if nearest is not None and replicate == nearest.replicate and np.array_equal(point, nearest.z):
                self._gradient_at_nearest = gradient
        return found

    def mean_gradient(self) -> np.ndarray | None:
        """Shrunk mean (k,) of all gradients so far; None for fewer than three.

        A run depends roughly on some numbers, such as on the attitude of a tumbling target: there the gradients at
        different points have no common direction, and a long step only succeeds along components in which they agree.
        """
        if len(self._gradients) < _MIN_GRADIENTS:
            return None
        return shrunk_mean(np.stack(self._gradients))

    def evaluate_gradient_at_nearest(self) -> None:
        """Evaluates the gradient at the nearest violation, if it is not known."""
        nearest = self.nearest_violation
        if nearest is not None and self._gradient_at_nearest is None and nearest.distance > 0.0:
            self.gradients(nearest.z[None], np.array([nearest.replicate]))

    def result(self) -> SearchResult:
        """Result of all evaluations so far."""
        assert self._smallest_margin is not None
        return SearchResult(
            nearest_violation=self.nearest_violation,
            first_violation=self._first_violation,
            smallest_margin=self._smallest_margin,
            alignment=self._alignment(),
            cost=self._cost,
            margin_evaluations=self._margin_evaluations,
            gradient_evaluations=self._gradient_evaluations,
        )

    def _alignment(self) -> float | None:
        if self.nearest_violation is None or self._gradient_at_nearest is None:
            return None
        size = float(np.linalg.norm(self._gradient_at_nearest)) * self.nearest_violation.distance
        aligned = np.isfinite(size) and size > 0.0
        return float(-self._gradient_at_nearest @ self.nearest_violation.z / size) if aligned else None

    def _charge(self, points: int, cost: float) -> None:
        batch_size = self._limit_state.batch_size
        price = -(-points // batch_size) * batch_size * cost
        if self._smallest_margin is not None and self._cost + price > self.settings.budget:
            raise BudgetExceededError
        self._cost += price

    def _record(self, point: EvaluatedPoint) -> None:
        if self._smallest_margin is None or point.margin < self._smallest_margin.margin:
            self._smallest_margin = point
        if point.margin <= 0.0:
            self._first_violation = self._first_violation or point
            if self.nearest_violation is None or point.distance < self.nearest_violation.distance:
                self.nearest_violation, self._gradient_at_nearest = point, None
