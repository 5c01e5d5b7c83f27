"""Limit of a metric that has a derivative: its margins, and its selection from a requirement or from options."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rpojax.analysis.reliability.search_settings import LimitChoice
from rpojax.errors import RpojaxError
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import RequirementSection, ScenarioFile

_ROUNDING = 1e-5
"""Fraction of the limit by which it must be exceeded: stored metrics are in single precision."""


@dataclass(frozen=True)
class MetricLimit:
    """A limit of a metric.

    Attributes:
        metric: name of a metric that has a derivative
        bound: on which side of the limit it must stay
        limit: in the metric's unit
    """

    metric: str
    bound: Literal["at most", "at least"]
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
        return _limit_of_requirement(file, requirement)
    assert metric is not None
    check_metric(file, "metric", metric)
    if limit is None or not math.isfinite(limit):
        raise RpojaxError.of_argument("limit", f"found {limit}, expected a number, with metric")
    if choice.bound not in ("at most", "at least"):
        raise RpojaxError.of_argument("bound", f"found {choice.bound!r}, expected 'at most' or 'at least'")
    return MetricLimit(metric, "at most" if choice.bound == "at most" else "at least", limit)


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
    known = [each for each, metric in metrics.items() if metric.has_derivative]
    if name not in known:
        what = "a metric with a derivative" if name in metrics else "a metric"
        raise RpojaxError.of_argument(argument, f"found {name!r}, expected {what}: {', '.join(known)}")
