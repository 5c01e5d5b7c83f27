"""Reduction of metrics accumulated tick by tick during the simulation, differentiable and without a history."""

import math
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
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
        weight: (metrics,) sum of weights
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
        weights.append(sums.weight[index] + weight)
    return Accumulators(total=jnp.stack(totals), weight=jnp.stack(weights))


def final_values(metrics: Sequence[Metric], sums: Accumulators) -> Float[Array, " metrics"]:
    """Metrics; 0 where no tick has any weight."""
    means = gradient_safe.safe_div(sums.total, sums.weight)
    results = []
    for index, metric in enumerate(metrics):
        match metric.reduction:
            case "mean":
                results.append(means[index])
            case "rms":
                results.append(gradient_safe.sqrt(means[index]))
            case _:
                results.append(sums.total[index])
    return jnp.stack(results)


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
            return jnp.where((weight > 0.0) & (value < total), value, total)
        case "max":
            return jnp.where((weight > 0.0) & (value > total), value, total)
        case "end" | "total":
            return value
        case _:
            # A value without weight may be undefined; excluded, it does not enter the derivative of the sum.
            return total + weight * jnp.where(weight > 0.0, value, 0.0)
