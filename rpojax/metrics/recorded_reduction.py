"""Reduction of metrics over recorded quantities, summed in order of time."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rpojax.errors import RpojaxError
from rpojax.metrics.metric_definition import Floats, Metric, Reduction, RunTiming
from rpojax.metrics.record_statistics import ratio, sum_in_time
from rpojax.metrics.time_windows import first_tick


def reduce_records(metric: Metric, records: Mapping[str, np.ndarray], timing: RunTiming) -> Floats:
    """Metric (runs,), NaN where undefined, from quantities (runs, ticks) or (runs, ticks, components).

    Raises:
        RpojaxError: the metric is evaluated during the simulation alone.
    """
    if metric.source not in ("records", "plugin"):
        raise RpojaxError(f"{metric.name}: found records, expected accumulation during the simulation")
    ticks = records[metric.inputs[0]].shape[1]
    window = slice(first_tick(metric.window, ticks, timing.tick_s), None)
    weighted = metric.weighted_value(np, {name: records[name][:, window] for name in metric.inputs})
    if callable(metric.reduction):
        return metric.reduction(weighted, timing)
    value, weight = weighted
    found = _reduced(metric, value, weight)
    return found if weight is None else np.where(_counts(metric.reduction, weight), found, np.nan)


def _counts(reduction: Reduction | None, weight: np.ndarray) -> NDArray[np.bool_]:
    """Whether any tick of a run has a weight (runs,), or the last one where it alone counts."""
    has_weight = np.asarray(weight > 0)
    return has_weight[:, -1] if reduction in ("end", "total") else np.any(has_weight, axis=1)


def _reduced(metric: Metric, value: np.ndarray, weight: np.ndarray | None) -> Floats:
    """Reduction (runs,) of values (runs, ticks, ...), arbitrary for runs without a weight (runs, ticks)."""
    over_ticks_and_components = tuple(range(1, value.ndim))
    match metric.reduction:
        case None:
            raise RpojaxError(f"{metric.name}: found no reduction, expected one over the ticks")
        case "mean":
            return _mean(value, weight)
        case "rms":
            return np.sqrt(_mean(_squared_norm(value), weight))
        case "sum":
            return _sum(value, weight)
        case "min":
            return _counted(value, weight, np.inf).min(axis=over_ticks_and_components).astype(float)
        case "max":
            return _counted(value, weight, -np.inf).max(axis=over_ticks_and_components).astype(float)
        case _:
            return value[:, -1].astype(float)


def reduce_in_window(
    metric: Metric, records: Mapping[str, np.ndarray], ticks: NDArray[np.bool_], timing: RunTiming, *, is_event: bool
) -> Floats:
    """Metric (runs,) of the flagged `ticks` (runs, ticks) in place of its own window; NaN without a flagged tick.

    A total since the start is what has been added from each of these ticks to the next, or the total at an event.

    Raises:
        RpojaxError: the metric is evaluated during the simulation alone.
    """
    found = np.full(len(ticks), np.nan)
    for run in np.flatnonzero(ticks.any(axis=1)):
        own = {name: records[name][run : run + 1] for name in metric.inputs}
        if metric.reduction == "total" and not is_event:
            total = metric.weighted_value(np, own).value[0].astype(float)
            found[run] = np.diff(total)[ticks[run, :-1]].sum()
            continue
        selected = {name: values[:, ticks[run]] for name, values in own.items()}
        first = timing._replace(first_tick=int(ticks[run].argmax()))
        found[run] = reduce_records(replace(metric, window="all"), selected, first)[0]
    return found


def _squared_norm(value: np.ndarray) -> np.ndarray:
    squares = np.square(value, dtype=float)
    return squares.sum(axis=2) if value.ndim == 3 else squares


def _counted(value: np.ndarray, weight: np.ndarray | None, neutral: float) -> np.ndarray:
    """The value, `neutral` where it has no weight."""
    if weight is None:
        return value
    return np.where(_like(value, weight), value.astype(np.result_type(value, np.float32)), neutral)


def _like(value: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weight of all components."""
    return weight[..., None] if value.ndim == 3 else weight


def _sum(value: np.ndarray, weight: np.ndarray | None) -> Floats:
    weighted = value if weight is None else _counted(value, weight, 0.0) * _like(value, weight)
    return sum_in_time(weighted.sum(axis=2, dtype=float) if value.ndim == 3 else weighted)


def _mean(value: np.ndarray, weight: np.ndarray | None) -> Floats:
    total = _sum(value, weight)
    if weight is None:
        return total / np.prod(value.shape[1:])
    return ratio(total, sum_in_time(weight) * np.prod(value.shape[2:]))
