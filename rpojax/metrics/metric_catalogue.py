"""All metrics by name, with their units, and which of them are better when greater; free of JAX.

Metrics of plugins stand beside these. What simulates or reads runs of one scenario looks names up among its own
metrics alone (`metrics_of_scenario`); elsewhere a name is looked up among those of all plugins of the process
(`register`), and refused if they mean different things by it.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from typing import Final

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.metrics import (
    approach,
    attitude,
    camera_boxes,
    capture,
    filter_consistency,
    filter_likelihood,
    navigation_health,
    passive_safety,
    plume,
    position_errors,
    surface_coverage,
    target_attitude,
    team,
    thrusters,
    trajectory,
)
from rpojax.metrics.metric_definition import Metric
from rpojax.metrics.time_windows import WINDOW_METRICS, split_name, window_in_words

MODULES: Final = (
    position_errors,
    filter_consistency,
    filter_likelihood,
    navigation_health,
    target_attitude,
    trajectory,
    approach,
    capture,
    plume,
    thrusters,
    passive_safety,
    attitude,
    camera_boxes,
    surface_coverage,
    team,
)
"""Modules with definitions, in display order."""

METRICS: Final[dict[str, Metric]] = {metric.name: metric for module in MODULES for metric in module.METRICS}
"""Every metric of the package by name, in display order."""

UNITS: Final[dict[str, str]] = {name: metric.unit for name, metric in METRICS.items() if metric.source != "simulation"}
"""Unit of every metric of the package that a campaign may have, by name."""

DIFFERENTIABLE: Final = [name for name, metric in METRICS.items() if metric.has_derivative]
"""Names of the package's metrics with a useful derivative, which are accumulated during the simulation."""

_OF_PLUGINS: Final[dict[str, list[Metric]]] = {}
"""Metrics of the plugins of this process by name, one for each description."""

_OF_SCENARIO: ContextVar[Mapping[str, Metric] | None] = ContextVar("metrics of the scenario's plugin", default=None)


def register(metrics: Iterable[Metric]) -> None:
    """Makes metrics of plugins known by their names.

    Raises:
        RpojaxError: a name is one of the package.
    """
    for metric in metrics:
        if metric.name in METRICS or passive_safety.metric_of_horizon(metric.name) or metric.name in WINDOW_METRICS:
            raise RpojaxError(f"metrics: found {metric.name!r}, expected a name that no metric of the package has")
        others = [each for each in _OF_PLUGINS.get(metric.name, []) if _description(each) != _description(metric)]
        _OF_PLUGINS[metric.name] = [*others, metric]


@contextmanager
def metrics_of_scenario(own: Mapping[str, Metric]) -> Iterator[None]:
    """Within it, only metrics of the package and those of one scenario's plugin, `own` by name, have names."""
    token = _OF_SCENARIO.set(own)
    try:
        yield
    finally:
        _OF_SCENARIO.reset(token)


def _description(metric: Metric) -> tuple[object, ...]:
    """What is told of a metric by its name alone."""
    return metric.unit, metric.title, metric.meaning, metric.low_is_bad, metric.has_derivative


def _of_plugins(name: str) -> list[Metric]:
    """Metrics of that name of the scenario's plugin, or without one of all plugins of the process."""
    own = _OF_SCENARIO.get()
    if own is None:
        return _OF_PLUGINS.get(name, [])
    return [own[name]] if name in own else []


def _of_plugin(name: str) -> Metric | None:
    found = _of_plugins(name)
    if len(found) > 1:
        meanings = " and ".join(map(_title_in_words, found))
        raise RpojaxError(f"metrics.{name}: found {meanings} in plugins of this process, expected one definition")
    return found[0] if found else None


def _title_in_words(metric: Metric) -> str:
    dof = metric.degrees_of_freedom
    return f"{metric.title!r} [{metric.unit}]" + ("" if dof is None else f" of {dof} degrees of freedom")


def find(name: str) -> Metric | None:
    """The metric of that name, in a window, of any horizon of free drift and of one servicer too; else None.

    Raises:
        RpojaxError: plugins of this process define it differently, and it is not said which scenario it is of.
    """
    whole, _, servicer = name.partition("/")
    if servicer:
        metric = find(whole)
        return None if metric is None else replace(metric, name=name, title=f"{metric.title}, {servicer}")
    base, window = split_name(name)
    known = METRICS.get(base) or passive_safety.metric_of_horizon(base) or _of_plugin(base)
    if not window:
        return known
    metric, words = WINDOW_METRICS.get(base, known), window_in_words(window)
    return None if metric is None or words is None else replace(metric, name=name, title=f"{metric.title} {words}")


def unit_of(name: str) -> str:
    """Unit of a metric of a campaign; `-` if it has none or is unknown."""
    metric = find(name)
    return "-" if metric is None else metric.unit


def is_of_campaigns(name: str) -> bool:
    """Whether every campaign has a metric of that name, over its own window."""
    if _of_plugins(name):
        return True
    metric = None if split_name(name)[1] or "/" in name else find(name)
    return metric is not None and metric.source != "simulation"


def worst_first(name: str, values: np.ndarray, low_is_bad: bool | None = None) -> np.ndarray:
    """Rows with a defined value of a metric in `values` (runs,), sorted from worst to best; the sort is stable.

    Which side is bad is that of the metric, unless a requirement says it: low values are where it has a least value.
    """
    defined = np.flatnonzero(np.isfinite(values))
    if low_is_bad is None:
        metric = find(name)
        low_is_bad = metric is not None and metric.low_is_bad
    goodness = values[defined] if low_is_bad else -values[defined]
    return defined[np.argsort(goodness, kind="stable")]
