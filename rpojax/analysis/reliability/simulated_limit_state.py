"""Limit state of simulated runs: margin of a metric as a function of a scenario's standard normal variables."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator, RolloutResult
from rpojax.analysis.reliability.search_settings import Bound, LimitChoice
from rpojax.errors import RpojaxError
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import RequirementSection, ScenarioFile
from rpojax.simulation.noise import run_keys

_ROUNDING = 1e-5
"""Fraction of the limit by which it must be exceeded: stored metrics are in single precision."""
_FORWARD_MODE_MAX_RUNS = 1
"""Batch size up to which the forward mode is the faster one."""


@dataclass(frozen=True)
class MetricLimit:
    """A limit of a metric.

    Attributes:
        metric: name of a metric that has a derivative
        bound: on which side of the limit it must stay
        limit: in the metric's unit
    """

    metric: str
    bound: Bound
    limit: float

    def margins(self, values: np.ndarray) -> np.ndarray:
        """Margins from values to where the limit is exceeded by more than rounding; positive inside."""
        room = self.limit - values if self.bound == "at most" else values - self.limit
        return room + _ROUNDING * abs(self.limit)

    def value_at_margin(self, margin: float) -> float:
        """Value with a margin."""
        room = margin - _ROUNDING * abs(self.limit)
        return self.limit - room if self.bound == "at most" else self.limit + room

    def is_violated(self, value: float) -> bool:
        """Whether a value is beyond the limit."""
        return value > self.limit if self.bound == "at most" else value < self.limit


def select_limit(file: ScenarioFile, choice: LimitChoice) -> MetricLimit:
    """Limit of a requirement of the scenario, or of a metric with its own limit.

    Raises:
        RpojaxError: naming the argument.
    """
    requirement, metric, limit = choice.requirement, choice.metric, choice.limit
    if (requirement is None) == (metric is None):
        found = "neither" if metric is None else "both"
        raise RpojaxError.of_argument("requirement, metric", f"found {found}, expected one of the two")
    if requirement is not None:
        if limit is not None:
            raise RpojaxError.of_argument("limit", f"found {limit}, expected it with metric only")
        if choice.bound is not None:
            raise RpojaxError.of_argument("bound", f"found {choice.bound!r}, expected it with metric only")
        return _limit_of_requirement(file, requirement)
    assert metric is not None
    check_metric(file, "metric", metric)
    if limit is None or not math.isfinite(limit):
        raise RpojaxError.of_argument("limit", f"found {limit}, expected a number, with metric")
    return MetricLimit(metric, side(choice.bound, plugin_registry.catalogue_of(file)[metric].low_is_bad), limit)


def side(bound: str | None, low_is_bad: bool) -> Bound:
    """Side of a limit on which a metric must stay: as named, else that where it is better.

    Raises:
        RpojaxError: the name is none of a side.
    """
    if bound not in (None, "at most", "at least"):
        raise RpojaxError.of_argument("bound", f"found {bound!r}, expected 'at most' or 'at least'")
    return "at least" if bound == "at least" or (bound is None and low_is_bad) else "at most"


def _limit_of_requirement(file: ScenarioFile, requirement: str) -> MetricLimit:
    of_whole_runs = [each for each in file.requirements if each.is_of_all_runs]
    known = [each.metric for each in of_whole_runs]
    chosen = [each for each in of_whole_runs if each.metric == requirement]
    if not chosen:
        expected = "a scenario with requirements on whole runs, whatever their outcome"
        if known:
            expected = f"one of the scenario's: {', '.join(known)}"
        raise RpojaxError.of_argument("requirement", f"found {requirement!r}, expected {expected}")
    check_metric(file, "requirement", requirement)
    one = with_one_limit(chosen)
    return MetricLimit(requirement, one.bound, one.limit)


def with_one_limit(requirements: Sequence[RequirementSection]) -> RequirementSection:
    """Of requirements on one metric, which must have one limit, that with the highest probability.

    Raises:
        RpojaxError: they have several limits, of which a name does not say which.
    """
    limits = list(dict.fromkeys(f"{each.bound} {each.limit:g}" for each in requirements))
    if len(limits) > 1:
        found = f"{requirements[0].metric!r} with the limits {', '.join(limits)}"
        raise RpojaxError.of_argument("requirement", f"found {found}, expected one; name it by metric, bound and limit")
    return max(requirements, key=lambda each: each.probability)


def check_metric(file: ScenarioFile, argument: str, name: str) -> None:
    """Refuses metrics that the scenario does not have, or that have no derivative.

    Raises:
        RpojaxError: naming the argument.
    """
    metrics = {n: each for n, each in plugin_registry.catalogue_of(file).items() if each.source != "simulation"}
    known = [key for key, metric in metrics.items() if metric.has_derivative]
    if name not in known:
        what = "a metric with a derivative" if name in metrics else "a metric"
        raise RpojaxError.of_argument(argument, f"found {name!r}, expected {what}: {', '.join(known)}")


@dataclass(frozen=True)
class EvaluationCosts:
    """Measured cost of a run and of its gradient.

    Attributes:
        batch_size: runs of a whole batch, over which times are averaged
        run_s: time of a run [s]
        gradient_s: time of a run with its gradient [s]
    """

    batch_size: int
    run_s: float
    gradient_s: float

    @property
    def gradient_run_equivalents(self) -> int:
        """Cost of a gradient in runs, rounded up so that timing noise rarely changes it."""
        return max(1, math.ceil(self.gradient_s / self.run_s))


class SimulatedLimitState:
    """Limit state of a metric in runs of a seed; a replicate is the run of that id, with its own sensor noise."""

    def __init__(self, evaluator: RolloutEvaluator, limit: MetricLimit, costs: EvaluationCosts, seed: int) -> None:
        self._evaluator, self._limit, self._costs, self._seed = evaluator, limit, costs, seed
        self._column = evaluator.metric_names.index(limit.metric)

    @property
    def gradient_cost(self) -> float:
        """Cost of a margin with its gradient, in runs."""
        return float(self._costs.gradient_run_equivalents)

    @property
    def batch_size(self) -> int:
        """Runs that are simulated together."""
        return self._evaluator.batch_size

    def margins(self, points: np.ndarray, replicates: np.ndarray) -> np.ndarray:
        """Margins (n,) of points (n, k) in runs (n,); minus infinity for runs that fail."""
        return self._margins(self._evaluator.evaluate(points, run_keys(self._seed, replicates)))

    def gradients(self, points: np.ndarray, replicates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Margins (n,) and their gradients (n, k)."""
        sign = -1.0 if self._limit.bound == "at most" else 1.0
        weights = sign * np.eye(len(self._evaluator.metric_names))[self._column]
        found, gradients = _weighted_gradients(self._evaluator, points, run_keys(self._seed, replicates), weights)
        return self._margins(found), gradients

    def _margins(self, found: RolloutResult) -> np.ndarray:
        values = found.metrics[:, self._column]
        return np.where(found.failed | ~np.isfinite(values), -np.inf, self._limit.margins(values))


def make_evaluator(space: StandardNormalSpace, metrics: Sequence[str], starts: int) -> RolloutEvaluator:
    """Metrics of runs as a function of the standard normal variables of a scenario, for `starts` starts at a time."""
    return RolloutEvaluator(space.file, space.values_at, space.dimension, metrics, runs=starts)


def measure_costs(evaluator: RolloutEvaluator, repeats: int = 2) -> EvaluationCosts:
    """Times a whole batch of runs and of gradients, both compiled; the fastest of `repeats` counts.

    On a CPU processor time is measured, so that other load of the machine does not count.
    """
    clock = time.process_time if jax.default_backend() == "cpu" else time.perf_counter
    runs = evaluator.batch_size
    points, keys = np.zeros((runs, evaluator.input_count)), run_keys(0, np.arange(runs))
    weights = np.ones(len(evaluator.metric_names))

    def fastest(evaluate: Callable[[], Any]) -> float:
        evaluate()
        times = []
        for _ in range(repeats):
            begin = clock()
            evaluate()
            times.append(clock() - begin)
        return min(times) / runs

    run_s = fastest(lambda: evaluator.evaluate(points, keys))
    return EvaluationCosts(runs, run_s, fastest(lambda: _weighted_gradients(evaluator, points, keys, weights)))


def _weighted_gradients(
    evaluator: RolloutEvaluator, points: np.ndarray, keys: np.ndarray, weights: np.ndarray
) -> tuple[RolloutResult, np.ndarray]:
    """Metrics of runs, and the gradients (n, k) of the sum of metrics with weights (metrics,).

    A single run leaves most vector lanes of the processor unused, and the forward mode fills them with directions: with
    26 of them it was measured to take 6 runs and the reverse mode 17; with four runs, 19 and 17.
    """
    if evaluator.batch_size <= _FORWARD_MODE_MAX_RUNS:
        found = evaluator.jacobian(points, keys)
        assert found.jacobian is not None
        return found, np.einsum("f,rfk->rk", weights, found.jacobian)
    found = evaluator.gradient(points, keys, np.tile(weights, (len(points), 1)))
    assert found.gradient is not None
    return found, found.gradient
