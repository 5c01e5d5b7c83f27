"""All metrics by name, with their units, and which of them are better when greater; free of JAX.

Metrics of plugins join those of the package when they become known to the process: `register`.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.metrics import (
    attitude,
    camera_boxes,
    filter_consistency,
    filter_likelihood,
    navigation_health,
    passive_safety,
    position_errors,
    surface_coverage,
    team,
    trajectory,
)
from rpojax.metrics.metric_definition import Metric
from rpojax.metrics.time_windows import WINDOW_METRICS, split_name, window_in_words

MODULES: Final = (
    position_errors,
    filter_consistency,
    filter_likelihood,
    navigation_health,
    trajectory,
    passive_safety,
    attitude,
    camera_boxes,
    surface_coverage,
    team,
)
"""Modules with definitions, in display order."""

METRICS: Final[dict[str, Metric]] = {metric.name: metric for module in MODULES for metric in module.METRICS}
"""Every metric by name, in display order."""

UNITS: Final[dict[str, str]] = {name: metric.unit for name, metric in METRICS.items() if metric.source != "simulation"}
"""Unit of every metric of a campaign by name."""

DIFFERENTIABLE: Final = [name for name, metric in METRICS.items() if metric.has_derivative]
"""Names of the metrics with a useful derivative, which are accumulated during the simulation."""

_PACKAGED: Final = frozenset(METRICS)


def register(metrics: Iterable[Metric]) -> None:
    """Makes metrics of plugins known by their names; a later definition replaces an earlier one of a plugin.

    Raises:
        RpojaxError: a name is one of the package.
    """
    for metric in metrics:
        if metric.name in _PACKAGED or passive_safety.metric_of_horizon(metric.name) or metric.name in WINDOW_METRICS:
            raise RpojaxError(f"metrics: found {metric.name!r}, expected a name that no metric of the package has")
        METRICS[metric.name], UNITS[metric.name] = metric, metric.unit
        if metric.name in DIFFERENTIABLE:
            DIFFERENTIABLE.remove(metric.name)
        if metric.has_derivative:
            DIFFERENTIABLE.append(metric.name)


def find(name: str) -> Metric | None:
    """The metric of that name, in a window, of any horizon of free drift and of one servicer too; else None."""
    whole, _, servicer = name.partition("/")
    if servicer:
        metric = find(whole)
        return None if metric is None else replace(metric, name=name, title=f"{metric.title}, {servicer}")
    base, window = split_name(name)
    known = METRICS.get(base) or passive_safety.metric_of_horizon(base)
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
    metric = None if split_name(name)[1] or "/" in name else find(name)
    return metric is not None and metric.source != "simulation"


def worst_first(name: str, values: np.ndarray) -> np.ndarray:
    """Rows with a defined value of a metric in `values` (runs,), sorted from worst to best; the sort is stable."""
    defined = np.flatnonzero(np.isfinite(values))
    metric = find(name)
    goodness = values[defined] if metric is not None and metric.low_is_bad else -values[defined]
    return defined[np.argsort(goodness, kind="stable")]
