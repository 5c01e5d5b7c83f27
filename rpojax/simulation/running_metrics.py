"""Figures of merit added up while a run flies, so that they have derivatives and no history is kept.

Those that `metrics` has, too, have the same name and value. The others stand in for metrics without a useful derivative
(a root mean square for a percentile), or are what an estimator is tuned by.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import gaussian_density, quaternion
from rpojax.core.numerics import safe
from rpojax.core.pytree import pytree
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.scenario import metric_catalogue
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.simulation import telemetry
from rpojax.simulation.closed_loop import Telemetry, true_relative_state

Scalar = Float[Array, ""]
WeightedValue = tuple[Scalar, Scalar]
"""Value and weight at a tick."""

FALSE_BOX_PROBABILITY: Final = 0.05
"""Share of boxes that `innovation_surprise` takes for false, whatever the gate says."""
_FALSE_BOX_LOG_SIZE_RANGE: Final = 3.0
"""False boxes are spread over so many units of log size, from a few pixels to the whole frame."""


@dataclass(frozen=True)
class MetricInputs:
    """A tick as the figures see it; what several figures need is worked out once.

    `settled` is 1 once the camera has looked at the target for the time to settle, else 0.
    """

    scenario: Scenario
    params: Params
    telemetry: Telemetry
    settled: Scalar

    @cached_property
    def errors(self) -> tuple[Array, Array]:
        """(6,) of the servicer and (6,) of the target relative to it, estimate less truth in N [m, m/s]."""
        return telemetry.orbit_errors(self.telemetry)

    @cached_property
    def servicer_density(self) -> tuple[Scalar, Scalar]:
        """Normalised square of the servicer's error, and log determinant of its covariance."""
        P = self.telemetry.flight.orbit.servicer.covariance[:6, :6]
        return gaussian_density.squared_mahalanobis_and_log_determinant(P, self.errors[0])

    @cached_property
    def relative_density(self) -> tuple[Scalar, Scalar]:
        """The same of the target relative to the servicer."""
        P = self.telemetry.flight.orbit.relative.covariance[:6, :6]
        return gaussian_density.squared_mahalanobis_and_log_determinant(P, self.errors[1])


@dataclass(frozen=True)
class RunningMetric:
    """How a figure of merit is made.

    Attributes:
        unit: of the figure
        observe: value and weight at a tick
        window: over `all` ticks, the `late` ones (from 1000 s, or a third of the run) or the `last` (as long)
        reduce: weighted `mean` or `rms`, least or greatest value, or the value at the end
    """

    unit: str
    evaluate: Callable[[MetricInputs], WeightedValue]
    window: Literal["all", "late", "last"]
    reduction: Literal["mean", "rms", "min", "max", "end"]


@pytree
class RunningSums:
    """What is carried along, one row per figure.

    Attributes:
        total: (figures,) sum so far, or extreme
        weight: (figures,) sum of weights
        looking: () ticks since the camera last looked elsewhere
        events: () uint32, changes with any box taken or refused and with any change of the guidance mode
    """

    total: Array
    weight: Array
    pointing_ticks: Array
    event_hash: Array


def initial_sums(names: Sequence[str]) -> RunningSums:
    """Sums before the first tick."""
    first = {"min": math.inf, "max": -math.inf}
    total = jnp.array([first.get(RUNNING_METRICS[name].reduction, 0.0) for name in names], dtype=jnp.float64)
    return RunningSums(
        total=total,
        weight=jnp.zeros_like(total),
        pointing_ticks=jnp.zeros((), dtype=jnp.float64),
        event_hash=jnp.zeros((), dtype=jnp.uint32),
    )


def add_tick(
    names: Sequence[str], scenario: Scenario, params: Params, seen: Telemetry, sums: RunningSums
) -> RunningSums:
    """Sums after one more tick."""
    looking = jnp.where(seen.mode == Mode.LOOK, sums.pointing_ticks + 1.0, 0.0)
    settled = jnp.where(looking > _settle_ticks(scenario, params), 1.0, 0.0)
    instant = MetricInputs(scenario, params, seen, settled)
    totals, weights = [], []
    for index, name in enumerate(names):
        figure = RUNNING_METRICS[name]
        value, weight = figure.evaluate(instant)
        weight = weight * _in_window(figure.window, scenario, seen.tick)
        totals.append(_accumulate(figure, sums.total[index], value, weight))
        weights.append(sums.weight[index] + weight)
    return RunningSums(
        total=jnp.stack(totals),
        weight=jnp.stack(weights),
        pointing_ticks=looking,
        event_hash=_updated_event_hash(sums.event_hash, seen),
    )


def _updated_event_hash(events: Array, seen: Telemetry) -> Array:
    """Fingerprint of the events so far with those of one more tick (a polynomial hash)."""
    found = seen.innovation
    accepted, rejected, mode = (word.astype(jnp.uint32) for word in (found.accepted, found.rejected, seen.mode))
    return events * jnp.uint32(1000003) + accepted + jnp.uint32(2) * rejected + jnp.uint32(4) * mode


def final_values(names: Sequence[str], sums: RunningSums) -> Float[Array, " figures"]:
    """The figures (figures,) in the order of their names; 0 where no tick had any weight."""
    means = safe.safe_div(sums.total, sums.weight)
    results = []
    for index, name in enumerate(names):
        match RUNNING_METRICS[name].reduction:
            case "mean":
                results.append(means[index])
            case "rms":
                results.append(safe.sqrt(means[index]))
            case _:
                results.append(sums.total[index])
    return jnp.stack(results)


def _accumulate(figure: RunningMetric, total: Scalar, value: Scalar, weight: Scalar) -> Scalar:
    match figure.reduction:
        case "min":
            return jnp.where((weight > 0.0) & (value < total), value, total)
        case "max":
            return jnp.where((weight > 0.0) & (value > total), value, total)
        case "end":
            return value
        case _:
            # What has no weight may be undefined, and must not spoil the derivative of the sum.
            return total + weight * jnp.where(weight > 0.0, value, 0.0)


def _in_window(window: str, scenario: Scenario, tick: Array) -> Scalar:
    late, last = metric_catalogue.window_starts(scenario.ticks, scenario.tick_s)
    first = {"all": 0, "late": late, "last": last}[window]
    return jnp.where(tick >= first, 1.0, 0.0)


def _settle_ticks(scenario: Scenario, params: Params) -> Scalar:
    return jnp.round(params.flight.pointing.settle_time / scenario.tick_s)


def _unit_weight() -> Scalar:
    return jnp.ones((), dtype=jnp.float64)


def _formation(at: MetricInputs) -> WeightedValue:
    rho_H, _ = true_relative_state(at.telemetry.truth)
    return jnp.sum((rho_H - at.params.flight.formation.desired_position) ** 2, axis=0), _unit_weight()


def _relative(at: MetricInputs) -> WeightedValue:
    return jnp.sum(at.errors[1][:3] ** 2, axis=0), _unit_weight()


def _servicer(at: MetricInputs) -> WeightedValue:
    return jnp.sum(at.errors[0][:3] ** 2, axis=0), _unit_weight()


def _target(at: MetricInputs) -> WeightedValue:
    return jnp.sum((at.errors[0] + at.errors[1])[:3] ** 2, axis=0), _unit_weight()


def _nees(at: MetricInputs) -> WeightedValue:
    return at.relative_density[0] + at.servicer_density[0], _unit_weight()


def _nees_relative(at: MetricInputs) -> WeightedValue:
    return at.relative_density[0], _unit_weight()


def _estimate_negative_log_likelihood(at: MetricInputs) -> WeightedValue:
    terms = (*at.relative_density, *at.servicer_density)
    return 0.5 * (sum(terms[1:], terms[0]) / 12.0 + math.log(2.0 * math.pi)), _unit_weight()


def _normalised_squares(at: MetricInputs, rows: slice) -> tuple[Array, Array]:
    found = at.telemetry.innovation
    return found.innovation[rows] ** 2 / found.variance[rows], found.weight[rows]


def _nis(at: MetricInputs, rows: slice) -> WeightedValue:
    square, weight = _normalised_squares(at, rows)
    return jnp.sum(square, axis=0), jnp.where(jnp.min(weight, axis=0) > 0.5, 1.0, 0.0)


def _innovation_negative_log_likelihood(at: MetricInputs) -> WeightedValue:
    """Minus log density per row, of boxes with a share of false ones, so that no gate decides what is counted."""
    found = at.telemetry.innovation
    densities = -0.5 * (jnp.log(2.0 * math.pi * found.variance) + found.innovation**2 / found.variance)
    there = jnp.where(found.weight[:3] > 0.5, 1.0, 0.0)
    gps, gps_rows = jnp.sum(there * densities[:3], axis=0), jnp.sum(there, axis=0)
    present = found.accepted | found.rejected
    box = at.telemetry.frame.box
    used = jnp.stack([_unit_weight(), _unit_weight(), jnp.where(box.truncated, 0.0, 1.0)])
    focal = at.params.flight.vehicle.focal_px
    area = at.scenario.width_px * at.scenario.height_px / focal**2
    false = -jnp.log(area) - used[2] * math.log(_FALSE_BOX_LOG_SIZE_RANGE)
    real = jnp.sum(used * densities[3:], axis=0)
    mixed = jnp.logaddexp(math.log1p(-FALSE_BOX_PROBABILITY) + real, math.log(FALSE_BOX_PROBABILITY) + false)
    rows = gps_rows + jnp.where(present, jnp.sum(used, axis=0), 0.0)
    total = gps + jnp.where(present, mixed, 0.0)
    return -safe.safe_div(total, rows), rows


def _pointing(at: MetricInputs) -> WeightedValue:
    truth = at.telemetry.truth
    across = quaternion.cross(telemetry.boresight_N(at.params, truth), safe.normalize(truth.r_ST_N))
    # While the camera looks at the target the angle is small: its sine is it.
    return jnp.rad2deg(1.0) ** 2 * jnp.sum(across**2, axis=0), at.settled


def _range(at: MetricInputs) -> WeightedValue:
    return safe.norm(at.telemetry.truth.r_ST_N), _unit_weight()


def _wheel_speed(at: MetricInputs) -> WeightedValue:
    return jnp.max(jnp.abs(at.telemetry.truth.wheel_speed / at.params.plant.wheels.speed_limit), axis=0), _unit_weight()


def _delta_v(at: MetricInputs) -> WeightedValue:
    return at.telemetry.truth.delta_v, _unit_weight()


RUNNING_METRICS: Final = {
    "formation_error_rms_m": RunningMetric("m", _formation, "last", "rms"),
    "nav_relative_position_error_rms_m": RunningMetric("m", _relative, "late", "rms"),
    "nav_servicer_position_error_rms_m": RunningMetric("m", _servicer, "late", "rms"),
    "nav_target_position_error_rms_m": RunningMetric("m", _target, "late", "rms"),
    "nees_mean": RunningMetric("-", _nees, "all", "mean"),
    "nees_relative_mean": RunningMetric("-", _nees_relative, "all", "mean"),
    "nis_gps_mean": RunningMetric("-", lambda at: _nis(at, slice(0, 3)), "all", "mean"),
    "nis_box_mean": RunningMetric("-", lambda at: _nis(at, slice(3, 6)), "all", "mean"),
    "innovation_surprise": RunningMetric("-", _innovation_negative_log_likelihood, "all", "mean"),
    "estimate_surprise": RunningMetric("-", _estimate_negative_log_likelihood, "all", "mean"),
    "delta_v_m_s": RunningMetric("m/s", _delta_v, "all", "end"),
    "min_range_m": RunningMetric("m", _range, "all", "min"),
    "wheel_speed_peak_fraction": RunningMetric("-", _wheel_speed, "all", "max"),
    "pointing_error_rms_deg": RunningMetric("deg", _pointing, "late", "rms"),
}
"""Figures by name: `estimate_surprise` is minus the log density of the truth under the estimate per component,
`innovation_surprise` that of the measurements under the filter's prediction per row."""
