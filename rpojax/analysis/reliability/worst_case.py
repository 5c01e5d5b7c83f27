"""The most likely combination of dispersions that breaks a requirement, found by derivatives and then really flown.

Everything that is not a dispersion made from normal numbers (sensor noise, hand-over errors, choices) stays what a
run's own random key gives: a search is on one run of a campaign, and several runs are tried.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import ndtr

from rpojax.analysis.gradients import rollout_evaluator
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.analysis.reliability import form_search
from rpojax.analysis.reliability.evaluation_log import EvaluatedPoint, SearchResult, SearchSettings
from rpojax.analysis.reliability.metric_limit import MetricLimit
from rpojax.campaign import run_and_resume
from rpojax.dispersions import standard_normal_space
from rpojax.dispersions.standard_normal_space import StandardNormalSpace
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile

_MOST_STARTS = 64
_FORWARD_UP_TO_RUNS = 1
"""Runs at a time up to which the forward mode is the faster one."""


@dataclass(frozen=True)
class EvaluationCosts:
    """What a flight and a gradient take, each for one run of a whole batch [s], and how many runs that is."""

    batch_size: int
    run_s: float
    gradient_s: float

    @property
    def gradient_run_equivalents(self) -> int:
        """What a gradient costs in flights, rounded up so that the noise of a clock rarely shows."""
        return max(1, math.ceil(self.gradient_s / self.run_s))


class SimulatedLimitState:
    """A bound as a function of the numbers behind a run's dispersions; lanes are runs of a campaign's seed."""

    def __init__(self, evaluator: RolloutEvaluator, bound: MetricLimit, costs: EvaluationCosts, seed: int) -> None:
        self._flights, self._bound, self._costs, self._seed = evaluator, bound, costs, seed
        self._column = evaluator.metric_names.index(bound.metric)

    @property
    def gradient_cost(self) -> float:
        """In flights."""
        return float(self._costs.gradient_run_equivalents)

    @property
    def batch_size(self) -> int:
        """Runs that fly together."""
        return self._flights.batch_size

    def margins(self, points: np.ndarray, replicates: np.ndarray) -> np.ndarray:
        """Margins (n,) of numbers (n, k) in runs (n,); minus infinity for runs that fail."""
        found = self._flights.evaluate(points, rollout_evaluator.run_keys(self._seed, replicates))
        return self._margins(found)

    def gradients(self, points: np.ndarray, replicates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Margins (n,) and their gradients (n, k)."""
        sign = -1.0 if self._bound.bound == "at most" else 1.0
        found, gradients = _gradients(
            self._flights,
            points,
            rollout_evaluator.run_keys(self._seed, replicates),
            sign * _only(self._flights, self._column),
        )
        return self._margins(found), gradients

    def _margins(self, found: rollout_evaluator.RolloutResult) -> np.ndarray:
        values = found.metrics[:, self._column]
        return np.where(found.failed | ~np.isfinite(values), -np.inf, self._bound.margins(values))


@dataclass(frozen=True)
class WorstCase:
    """The most likely violation that was found, or how close the search came.

    Attributes:
        bound: that was to be broken
        space: the numbers behind the dispersions
        seed: of the campaign
        found: by the search, in those numbers
        costs: of flights and gradients
        compile_s: [s]
        values: of the dispersed keys in the user's units at the nearest violation, else at the closest point
    """

    limit: MetricLimit
    space: StandardNormalSpace
    seed: int
    search: SearchResult
    costs: EvaluationCosts
    compile_s: float
    values: dict[str, Any]

    @property
    def reported_point(self) -> EvaluatedPoint:
        """The nearest violation, or the closest point where there is none."""
        return self.search.nearest_violation or self.search.smallest_margin

    @property
    def probability(self) -> float | None:
        """First-order probability of a violation in runs with this run's noise; None without a violation."""
        return None if self.search.nearest_violation is None else float(ndtr(-self.search.nearest_violation.distance))

    @property
    def pinned_scenario(self) -> ScenarioFile:
        """The scenario with the dispersions of the point that is shown as choices of one value."""
        return standard_normal_space.with_fixed_values(self.space, self.values)


def check_settings(effort: SearchSettings) -> None:
    """Refuses efforts that find nothing.

    Raises:
        RpojaxError: naming the option.
    """
    if not 1 <= effort.starts <= _MOST_STARTS:
        raise RpojaxError(f"--starts: found {effort.starts}, expected 1 to {_MOST_STARTS}")
    if not effort.budget >= effort.screening_points:
        raise RpojaxError(
            f"--budget: found {effort.budget:g}, expected at least the {effort.screening_points} first flights"
        )


def make_evaluator(space: StandardNormalSpace, metrics: Sequence[str], starts: int) -> RolloutEvaluator:
    """Flights of a scenario as a function of the numbers behind its dispersions, for so many starts at a time."""
    return RolloutEvaluator(space.file, space.values_at, space.dimension, metrics, runs=starts)


def _only(flights: RolloutEvaluator, column: int) -> np.ndarray:
    """Weights (figures,) that leave one figure."""
    return np.eye(len(flights.metric_names))[column]


def _gradients(
    flights: RolloutEvaluator, points: np.ndarray, keys: np.ndarray, weights: np.ndarray
) -> tuple[rollout_evaluator.RolloutResult, np.ndarray]:
    """Figures of runs, and the gradients (n, k) of the sum of figures with weights (figures,).

    A run alone leaves most of what the processor does at once unused, and the forward mode fills it with directions:
    measured with 26 of them, it takes 6 flights and the reverse mode 17; with four runs, 19 and 17.
    """
    if flights.batch_size <= _FORWARD_UP_TO_RUNS:
        found = flights.jacobian(points, keys)
        assert found.jacobian is not None
        return found, np.einsum("f,rfk->rk", weights, found.jacobian)
    found = flights.gradient(points, keys, np.tile(weights, (len(points), 1)))
    assert found.gradient is not None
    return found, found.gradient


def measure_costs(flights: RolloutEvaluator, repeats: int = 2) -> EvaluationCosts:
    """Times a whole batch of flights and of gradients, both compiled; the fastest of `repeats` counts.

    On a CPU it is the processor's time that counts: what else the machine does is no cost of a gradient.
    """
    clock = time.process_time if jax.default_backend() == "cpu" else time.perf_counter
    runs = flights.batch_size
    numbers, keys = np.zeros((runs, flights.input_count)), rollout_evaluator.run_keys(0, np.arange(runs))
    weights = np.ones(len(flights.metric_names))

    def fastest(fly: Callable[[], Any]) -> float:
        fly()
        times = []
        for _ in range(repeats):
            begin = clock()
            fly()
            times.append(clock() - begin)
        return min(times) / runs

    flight_s = fastest(lambda: flights.evaluate(numbers, keys))
    return EvaluationCosts(runs, flight_s, fastest(lambda: _gradients(flights, numbers, keys, weights)))


def search_worst_case(
    space: StandardNormalSpace,
    bound: MetricLimit,
    settings: SearchSettings,
    seed: int,
    evaluator: RolloutEvaluator | None = None,
    costs: EvaluationCosts | None = None,
) -> WorstCase:
    """The most likely violation of a bound in runs of a seed; `flights` and their `costs` may be used again.

    Raises:
        RpojaxError: the effort can find nothing.
    """
    check_settings(settings)
    flown = evaluator or make_evaluator(space, (bound.metric,), settings.starts)
    measured = costs or measure_costs(flown)
    found = form_search.find_design_point(
        SimulatedLimitState(flown, bound, measured, seed), space.dimension, settings, seed
    )
    shown = found.nearest_violation or found.smallest_margin
    key = rollout_evaluator.run_keys(seed, np.array([shown.replicate]))[0]
    values = jax.jit(space.values_at)(jnp.asarray(shown.z), jnp.asarray(key))
    plain = {name: np.asarray(value) for name, value in values.items()}
    return WorstCase(bound, space, seed, found, measured, flown.compile_s, plain)


def simulate_worst_case(worst: WorstCase, directory: Path, force: bool = False) -> float:
    """Flies the point that is shown as `rpojax run` does, into a campaign folder; the metric that it has there.

    Raises:
        RpojaxError: the folder cannot be used.
    """
    flown = run_and_resume.run_campaign(
        worst.pinned_scenario,
        1,
        directory,
        worst.seed,
        first_run=worst.reported_point.replicate,
        block_size=1,
        force=force,
    )
    return float(flown.metrics[worst.limit.metric][0]) if flown.completed.all() else math.nan
