"""Reduction of metrics accumulated tick by tick during the simulation, differentiable and without a history."""

import math
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Integer

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.errors import RpojaxError
from rpojax.metrics.metric_definition import Metric
from rpojax.metrics.time_windows import first_tick

Scalar = Float[Array, ""]


@pytree
class Accumulators:
    """Accumulators, one row for each metric.

    Attributes:
        total: (metrics,) weighted sum, or extreme value
        weight: (metrics,) sum of weights, or that of the last tick where it alone counts
    """

    total: Array
    weight: Array


def initial_accumulators(metrics: Sequence[Metric]) -> Accumulators:
    """Accumulators before the first tick.

    Raises:
        RpojaxError: a metric needs whole records.
    """
    first = {"min": math.inf, "max": -math.inf}
    for metric in metrics:
        if callable(metric.reduction):
            raise RpojaxError(f"{metric.name}: found accumulation during the simulation, expected whole records")
    total = jnp.array([first.get(str(metric.reduction), 0.0) for metric in metrics], dtype=jnp.float64)
    return Accumulators(total=total, weight=jnp.zeros_like(total))


def accumulate(
    metrics: Sequence[Metric],
    quantities: Mapping[str, Array],
    sums: Accumulators,
    tick: Integer[Array, ""],
    ticks: int,
    tick_s: float,
) -> Accumulators:
    """Accumulators after one more tick of a run of `ticks`, with `quantities` () or (components,) of that tick."""
    totals, weights = [], []
    for index, metric in enumerate(metrics):
        value, weight = _reduced_over_components(metric, quantities)
        weight = weight * jnp.where(tick >= first_tick(metric.window, ticks, tick_s), 1.0, 0.0)
        totals.append(_accumulated(metric, sums.total[index], value, weight))
        of_last_tick = metric.reduction in ("end", "total")
        weights.append(weight if of_last_tick else sums.weight[index] + weight)
    return Accumulators(total=jnp.stack(totals), weight=jnp.stack(weights))


def final_values(metrics: Sequence[Metric], sums: Accumulators) -> Float[Array, " metrics"]:
    """Metrics; NaN, with a derivative of 0, where no tick has any weight, and where a value that counts is NaN."""
    is_mean = np.array([metric.reduction in ("mean", "rms") for metric in metrics])
    is_defined = (sums.weight > 0.0) & ~jnp.isnan(sums.total)
    # Undefined values are replaced before and after the operations, so that no NaN enters a derivative.
    totals = jnp.where(is_defined, sums.total, 1.0) / jnp.where(is_mean & is_defined, sums.weight, 1.0)
    results = [
        gradient_safe.sqrt(total) if metric.reduction == "rms" else total
        for metric, total in zip(metrics, totals, strict=True)
    ]
    return jnp.where(is_defined, jnp.stack(results), jnp.nan)


def _reduced_over_components(metric: Metric, quantities: Mapping[str, Array]) -> tuple[Scalar, Scalar]:
    """Value of a tick, for `rms` squared, and its weight."""
    value, weight = metric.weighted_value(jnp, quantities)
    value = jnp.asarray(value, dtype=jnp.float64)
    if metric.reduction == "rms":
        value = value * value
    if value.ndim > 0:
        value = _OVER_COMPONENTS[str(metric.reduction)](value, axis=-1)
    return value, jnp.asarray(1.0 if weight is None else weight, dtype=jnp.float64)


_OVER_COMPONENTS = {"mean": jnp.mean, "rms": jnp.sum, "sum": jnp.sum, "min": jnp.min, "max": jnp.max}


def _accumulated(metric: Metric, total: Scalar, value: Scalar, weight: Scalar) -> Scalar:
    match metric.reduction:
        case "min":
            return jnp.where((weight > 0.0) & ((value < total) | jnp.isnan(value)), value, total)
        case "max":
            return jnp.where((weight > 0.0) & ((value > total) | jnp.isnan(value)), value, total)
        case "end" | "total":
            return value
        case _:
            # A value without weight may be undefined; excluded, it does not enter the derivative of the sum.
            return total + weight * jnp.where(weight > 0.0, value, 0.0)
