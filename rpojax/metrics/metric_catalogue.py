"""All metrics by name, with their units, and which of them are better when greater; free of JAX."""

from typing import Final

import numpy as np

from rpojax.metrics import (
    attitude,
    camera_boxes,
    filter_consistency,
    filter_likelihood,
    position_errors,
    trajectory,
)
from rpojax.metrics.metric_definition import Metric

MODULES: Final = (position_errors, filter_consistency, filter_likelihood, trajectory, attitude, camera_boxes)
"""Modules with definitions, in display order."""

METRICS: Final[dict[str, Metric]] = {metric.name: metric for module in MODULES for metric in module.METRICS}
"""Every metric by name, in display order."""

UNITS: Final[dict[str, str]] = {name: metric.unit for name, metric in METRICS.items() if metric.is_recorded}
"""Unit of every metric of a campaign by name."""

LOW_IS_BAD: Final = frozenset(name for name, metric in METRICS.items() if metric.low_is_bad)
"""Metrics of which low values are worse."""

DIFFERENTIABLE: Final = tuple(name for name, metric in METRICS.items() if metric.has_derivative)
"""Names of the metrics with a useful derivative, which are accumulated during the simulation."""


def worst_first(name: str, values: np.ndarray) -> np.ndarray:
    """Rows with a defined value of a metric in `values` (runs,), sorted from worst to best; the sort is stable."""
    defined = np.flatnonzero(np.isfinite(values))
    goodness = values[defined] if name in LOW_IS_BAD else -values[defined]
    return defined[np.argsort(goodness, kind="stable")]
