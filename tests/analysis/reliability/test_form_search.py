"""The search for a design point on functions whose nearest point beyond the limit is known."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from rpojax.analysis.reliability import evaluation_log, form_search
from rpojax.analysis.reliability.search_settings import SearchSettings

COUNT = 26
AXIS = np.arange(1.0, COUNT + 1.0) / np.linalg.norm(np.arange(1.0, COUNT + 1.0))
AMPLE = SearchSettings(starts=2, screening_points=16, budget=1000.0)


@dataclass
class Known:
    """A margin with its gradient, both functions of one point; counts what it is asked for."""

    margin: Callable[[np.ndarray], float]
    slope: Callable[[np.ndarray], np.ndarray]
    gradient_cost: float = 8.0
    batch_size: int = 1
    asked: float = 0.0

    def margins(self, points: np.ndarray, replicates: np.ndarray) -> np.ndarray:
        assert len(points) == len(replicates)
        self.asked += len(points)
        return np.array([self.margin(point) for point in points])

    def gradients(self, points: np.ndarray, replicates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        margins = self.margins(points, replicates)
        self.asked += (self.gradient_cost - 1.0) * len(points)
        return margins, np.array([self.slope(point) for point in points])


def plane(distance: float) -> Known:
    return Known(lambda z: float(2.0 * (distance - AXIS @ z)), lambda z: -2.0 * AXIS)


def bowl(distance: float, curvature: float) -> Known:
    """Limit surface that bends away from the origin for a positive curvature, towards it for a negative one."""

    def slope(z: np.ndarray) -> np.ndarray:
        return 2.0 * curvature * (z - (AXIS @ z) * AXIS) - AXIS

    def margin(z: np.ndarray) -> float:
        across = z - (AXIS @ z) * AXIS
        return float(distance - AXIS @ z + curvature * (across @ across))

    return Known(margin, slope)


@pytest.mark.parametrize("distance", [0.5, 3.0, 5.5])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_foot_of_a_plane_is_found(distance: float, seed: int) -> None:
    found = form_search.find_design_point(plane(distance), COUNT, AMPLE, seed)
    assert found.nearest_violation is not None
    assert found.first_violation is not None
    assert found.alignment is not None
    assert (1.0 - 1e-9) * distance <= found.nearest_violation.distance < 1.02 * distance
    assert found.alignment == pytest.approx(1.0, abs=1e-3)
    assert found.first_violation.cost <= 16 + 4 * 8 + 2 * (8 + 5)


@pytest.mark.parametrize("curvature", [-0.1, 0.05, 0.2])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_nearest_point_of_a_curved_limit_is_found(curvature: float, seed: int) -> None:
    found = form_search.find_design_point(bowl(3.0, curvature), COUNT, AMPLE, seed)
    assert found.nearest_violation is not None
    # A surface bent by more than 1 / (2 distance) towards the origin is nearest off its axis.
    nearest = 3.0 if 2.0 * -curvature * 3.0 <= 1.0 else np.sqrt(3.0 / 0.1 - 1.0 / (4.0 * 0.1**2))
    assert (1.0 - 1e-9) * nearest <= found.nearest_violation.distance < 1.05 * nearest


def test_a_limit_out_of_reach_is_not_found_but_approached() -> None:
    found = form_search.find_design_point(plane(8.0), COUNT, AMPLE, 0)
    assert found.nearest_violation is None
    assert found.first_violation is None
    assert found.alignment is None
    assert found.smallest_margin.distance == pytest.approx(6.0)
    assert found.smallest_margin.margin == pytest.approx(2.0 * (8.0 - 6.0))


def test_a_limit_that_is_broken_at_the_origin_takes_no_search() -> None:
    found = form_search.find_design_point(plane(-1.0), COUNT, AMPLE, 0)
    assert found.nearest_violation is not None
    assert found.nearest_violation.distance == 0.0
    assert (found.cost, found.gradient_evaluations) == (16.0, 0)


def test_lost_runs_and_missing_derivatives_do_not_end_the_search() -> None:
    """Beyond the limit nothing is told but that it is broken, and before it every third derivative is not a number."""
    calls = iter(range(10**6))

    def slope(z: np.ndarray) -> np.ndarray:
        return np.full(COUNT, np.nan) if next(calls) % 3 == 1 else -AXIS

    lost = Known(lambda z: float(3.0 - AXIS @ z) if AXIS @ z < 3.0 else -np.inf, slope)
    found = form_search.find_design_point(lost, COUNT, AMPLE, 0)
    assert found.nearest_violation is not None
    assert found.nearest_violation.margin == -np.inf
    assert 3.0 - 1e-9 <= found.nearest_violation.distance < 4.5


@pytest.mark.parametrize(("batch", "budget"), [(1, 60.0), (4, 100.0), (4, 200.0)])
def test_the_budget_is_kept_and_everything_is_counted(batch: int, budget: float) -> None:
    limit = plane(5.0)
    limit.batch_size = batch
    found = form_search.find_design_point(limit, COUNT, SearchSettings(starts=2, budget=budget), 1)
    assert found.cost <= budget
    assert limit.asked == found.margin_evaluations + 8.0 * found.gradient_evaluations
    assert found.cost >= limit.asked
    assert found.cost == limit.asked or batch > 1


def test_runs_go_on_where_gradients_are_dearer_than_the_budget() -> None:
    limit = replace(bowl(8.0, 0.05), gradient_cost=1e6)
    found = form_search.find_design_point(limit, COUNT, AMPLE, 0)
    assert found.nearest_violation is None
    assert found.gradient_evaluations == 0
    # The next round of random runs would exceed what is left.
    assert AMPLE.budget - AMPLE.screening_points < found.cost <= AMPLE.budget
    assert found.cost == found.margin_evaluations == limit.asked


def test_every_start_is_on_a_lane_of_its_own() -> None:
    screened: set[int] = set()
    limit = bowl(8.0, 0.05)
    margins, gradients = limit.margins, limit.gradients

    def tried(points: np.ndarray, replicates: np.ndarray) -> np.ndarray:
        screened.update(replicates.tolist())
        return margins(points, replicates)

    def climbed(points: np.ndarray, replicates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert len(set(replicates.tolist())) == len(replicates)
        return gradients(points, replicates)

    limit.margins, limit.gradients = tried, climbed  # type: ignore[method-assign]
    found = form_search.find_design_point(limit, COUNT, AMPLE, 0)
    assert found.gradient_evaluations > 4
    assert screened == set(range(len(screened)))
    assert len(screened) > 2 * 16


def rough(scatter: float) -> Known:
    """A plane at 4 sigmas whose every point is off by chance, and whose derivatives are nothing but chance."""

    def chance(z: np.ndarray) -> np.random.Generator:
        return np.random.default_rng(np.abs(z * 1e6).astype(np.int64).tolist())

    return Known(
        lambda z: float(4.0 - AXIS @ z + scatter * chance(z).normal()),
        lambda z: 5.0 * chance(z).normal(size=COUNT),
        gradient_cost=18.0,
    )


def test_shots_meet_a_rare_violation_that_derivatives_do_not_lead_to() -> None:
    spent = []
    for seed in range(20):
        found = form_search.find_design_point(rough(0.8), COUNT, SearchSettings(budget=400.0), seed)
        assert found.first_violation is not None
        spent.append(found.first_violation.cost)
    # One point in a thousand is beyond the limit: sqrt(1 + 0.8^2) sigmas are 1.28, and 4 are 3.1 of them.
    assert np.mean(spent) < 60.0


def ripples() -> Known:
    """A plane at 4 sigmas under ripples in three numbers, whose slopes are four times as steep and lead nowhere."""

    def slope(z: np.ndarray) -> np.ndarray:
        return -AXIS + np.where(np.arange(COUNT) < 3, 4.0 * np.cos(40.0 * z), 0.0)

    return Known(lambda z: float(4.0 - AXIS @ z + 0.1 * np.sin(40.0 * z[:3]).sum()), slope)


@pytest.mark.parametrize("seed", range(4))
def test_what_gradients_agree_on_leads_through_ripples(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    effort = SearchSettings(starts=4, screening_points=16, budget=400.0)
    monkeypatch.setattr(form_search, "_LINE_SEARCH_ROUNDS", 0)
    found = form_search.find_design_point(ripples(), COUNT, effort, seed)
    assert found.nearest_violation is not None
    monkeypatch.setattr(evaluation_log.EvaluationLog, "mean_gradient", lambda book: None)
    alone = form_search.find_design_point(ripples(), COUNT, effort, seed)
    assert alone.nearest_violation is None or found.nearest_violation.distance < alone.nearest_violation.distance
