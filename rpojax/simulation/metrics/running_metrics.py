"""Metrics accumulated during the simulation, differentiable and without a history.

Those of the same name as in `metrics` have the same value. The others replace metrics without a useful derivative (a
root mean square for a percentile), or are objectives of filter tuning.
"""

import math
from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.scenario import metric_catalogue
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.metrics.running_metric_definitions import RUNNING_METRICS, MetricInputs, RunningMetric
from rpojax.simulation.telemetry import Telemetry

Scalar = Float[Array, ""]


@pytree
class RunningSums:
    """Accumulators, one row for each metric.

    Attributes:
        total: (metrics,) weighted sum, or extreme value
        weight: (metrics,) sum of weights
        pointing_ticks: () ticks for which the camera has pointed at the target
        event_hash: () uint32, hash of all accepted and rejected boxes and of the pointing modes
    """

    total: Array
    weight: Array
    pointing_ticks: Array
    event_hash: Array


def initial_sums(names: Sequence[str]) -> RunningSums:
    """Accumulators before the first tick."""
    first = {"min": math.inf, "max": -math.inf}
    total = jnp.array([first.get(RUNNING_METRICS[name].reduction, 0.0) for name in names], dtype=jnp.float64)
    return RunningSums(
        total=total,
        weight=jnp.zeros_like(total),
        pointing_ticks=jnp.zeros((), dtype=jnp.float64),
        event_hash=jnp.zeros((), dtype=jnp.uint32),
    )


def add_tick(
    names: Sequence[str], scenario: Scenario, params: Params, telemetry: Telemetry, sums: RunningSums
) -> RunningSums:
    """Accumulators after one more tick."""
    pointing_ticks = jnp.where(telemetry.mode == Mode.LOOK, sums.pointing_ticks + 1.0, 0.0)
    settled = jnp.where(pointing_ticks > _settle_ticks(scenario, params), 1.0, 0.0)
    inputs = MetricInputs(scenario, params, telemetry, settled)
    totals, weights = [], []
    for index, name in enumerate(names):
        metric = RUNNING_METRICS[name]
        value, weight = metric.evaluate(inputs)
        weight = weight * _in_window(metric.window, scenario, telemetry.tick)
        totals.append(_accumulate(metric, sums.total[index], value, weight))
        weights.append(sums.weight[index] + weight)
    return RunningSums(
        total=jnp.stack(totals),
        weight=jnp.stack(weights),
        pointing_ticks=pointing_ticks,
        event_hash=_updated_event_hash(sums.event_hash, telemetry),
    )


def _updated_event_hash(events: Array, telemetry: Telemetry) -> Array:
    """Polynomial hash of the events up to and including those of a tick."""
    innovation = telemetry.innovation
    accepted, rejected, mode = (
        word.astype(jnp.uint32) for word in (innovation.accepted, innovation.rejected, telemetry.mode)
    )
    return events * jnp.uint32(1000003) + accepted + jnp.uint32(2) * rejected + jnp.uint32(4) * mode


def final_values(names: Sequence[str], sums: RunningSums) -> Float[Array, " metrics"]:
    """Metrics in the order of `names`; 0 where no tick has any weight."""
    means = gradient_safe.safe_div(sums.total, sums.weight)
    results = []
    for index, name in enumerate(names):
        match RUNNING_METRICS[name].reduction:
            case "mean":
                results.append(means[index])
            case "rms":
                results.append(gradient_safe.sqrt(means[index]))
            case _:
                results.append(sums.total[index])
    return jnp.stack(results)


def _accumulate(metric: RunningMetric, total: Scalar, value: Scalar, weight: Scalar) -> Scalar:
    match metric.reduction:
        case "min":
            return jnp.where((weight > 0.0) & (value < total), value, total)
        case "max":
            return jnp.where((weight > 0.0) & (value > total), value, total)
        case "end":
            return value
        case _:
            # A value without weight may be undefined; excluded, it does not enter the derivative of the sum.
            return total + weight * jnp.where(weight > 0.0, value, 0.0)


def _in_window(window: str, scenario: Scenario, tick: Array) -> Scalar:
    late, last = metric_catalogue.window_starts(scenario.ticks, scenario.tick_s)
    first = {"all": 0, "late": late, "last": last}[window]
    return jnp.where(tick >= first, 1.0, 0.0)


def _settle_ticks(scenario: Scenario, params: Params) -> Scalar:
    return jnp.round(params.flight.pointing.settle_time / scenario.tick_s)
