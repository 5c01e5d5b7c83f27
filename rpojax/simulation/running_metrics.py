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
from rpojax.simulation.closed_loop import Telemetry, relative_state

Scalar = Float[Array, ""]
Observation = tuple[Scalar, Scalar]
"""Value and weight at a tick."""

FALSE_BOX_SHARE: Final = 0.05
"""Share of boxes that `innovation_surprise` takes for false, whatever the gate says."""
_FALSE_BOX_LOG_SIZES: Final = 3.0
"""False boxes are spread over so many units of log size, from a few pixels to the whole frame."""


@dataclass(frozen=True)
class Instant:
    """A tick as the figures see it; what several figures need is worked out once.

    `settled` is 1 once the camera has looked at the target for the time to settle, else 0.
    """

    scenario: Scenario
    params: Params
    seen: Telemetry
    settled: Scalar

    @cached_property
    def errors(self) -> tuple[Array, Array]:
        """(6,) of the servicer and (6,) of the target relative to it, estimate less truth in N [m, m/s]."""
        return telemetry.orbit_errors(self.seen)

    @cached_property
    def servicer_density(self) -> tuple[Scalar, Scalar]:
        """Normalised square of the servicer's error, and log determinant of its covariance."""
        P = self.seen.flight.orbit.servicer.covariance[:6, :6]
        return gaussian_density.square_and_log_determinant(P, self.errors[0])

    @cached_property
    def relative_density(self) -> tuple[Scalar, Scalar]:
        """The same of the target relative to the servicer."""
        P = self.seen.flight.orbit.relative.covariance[:6, :6]
        return gaussian_density.square_and_log_determinant(P, self.errors[1])


@dataclass(frozen=True)
class Figure:
    """How a figure of merit is made.

    Attributes:
        unit: of the figure
        observe: value and weight at a tick
        window: over `all` ticks, the `late` ones (from 1000 s, or a third of the run) or the `last` (as long)
        reduce: weighted `mean` or `rms`, least or greatest value, or the value at the end
    """

    unit: str
    observe: Callable[[Instant], Observation]
    window: Literal["all", "late", "last"]
    reduce: Literal["mean", "rms", "min", "max", "end"]


@pytree
class Sums:
    """What is carried along, one row per figure.

    Attributes:
        total: (figures,) sum so far, or extreme
        weight: (figures,) sum of weights
        looking: () ticks since the camera last looked elsewhere
        events: () uint32, changes with any box taken or refused and with any change of the guidance mode
    """

    total: Array
    weight: Array
    looking: Array
    events: Array


def start(names: Sequence[str]) -> Sums:
    """Sums before the first tick."""
    first = {"min": math.inf, "max": -math.inf}
    total = jnp.array([first.get(FIGURES[name].reduce, 0.0) for name in names], dtype=jnp.float64)
    return Sums(
        total=total,
        weight=jnp.zeros_like(total),
        looking=jnp.zeros((), dtype=jnp.float64),
        events=jnp.zeros((), dtype=jnp.uint32),
    )


def add(names: Sequence[str], scenario: Scenario, params: Params, seen: Telemetry, sums: Sums) -> Sums:
    """Sums after one more tick."""
    looking = jnp.where(seen.mode == Mode.LOOK, sums.looking + 1.0, 0.0)
    settled = jnp.where(looking > _settle_ticks(scenario, params), 1.0, 0.0)
    instant = Instant(scenario, params, seen, settled)
    totals, weights = [], []
    for index, name in enumerate(names):
        figure = FIGURES[name]
        value, weight = figure.observe(instant)
        weight = weight * _inside(figure.window, scenario, seen.tick)
        totals.append(_accumulate(figure, sums.total[index], value, weight))
        weights.append(sums.weight[index] + weight)
    return Sums(
        total=jnp.stack(totals), weight=jnp.stack(weights), looking=looking, events=_fingerprint(sums.events, seen)
    )


def _fingerprint(events: Array, seen: Telemetry) -> Array:
    """Fingerprint of the events so far with those of one more tick (a polynomial hash)."""
    found = seen.innovation
    accepted, rejected, mode = (word.astype(jnp.uint32) for word in (found.accepted, found.rejected, seen.mode))
    return events * jnp.uint32(1000003) + accepted + jnp.uint32(2) * rejected + jnp.uint32(4) * mode


def finish(names: Sequence[str], sums: Sums) -> Float[Array, " figures"]:
    """The figures (figures,) in the order of their names; 0 where no tick had any weight."""
    means = safe.safe_div(sums.total, sums.weight)
    results = []
    for index, name in enumerate(names):
        match FIGURES[name].reduce:
            case "mean":
                results.append(means[index])
            case "rms":
                results.append(safe.sqrt(means[index]))
            case _:
                results.append(sums.total[index])
    return jnp.stack(results)


def _accumulate(figure: Figure, total: Scalar, value: Scalar, weight: Scalar) -> Scalar:
    match figure.reduce:
        case "min":
            return jnp.where((weight > 0.0) & (value < total), value, total)
        case "max":
            return jnp.where((weight > 0.0) & (value > total), value, total)
        case "end":
            return value
        case _:
            # What has no weight may be undefined, and must not spoil the derivative of the sum.
            return total + weight * jnp.where(weight > 0.0, value, 0.0)


def _inside(window: str, scenario: Scenario, tick: Array) -> Scalar:
    late, last = metric_catalogue.late_and_last(scenario.ticks, scenario.tick_s)
    first = {"all": 0, "late": late, "last": last}[window]
    return jnp.where(tick >= first, 1.0, 0.0)


def _settle_ticks(scenario: Scenario, params: Params) -> Scalar:
    return jnp.round(params.flight.pointing.settle_time / scenario.tick_s)


def _one() -> Scalar:
    return jnp.ones((), dtype=jnp.float64)


def _formation(at: Instant) -> Observation:
    rho_H, _ = relative_state(at.seen.truth)
    return jnp.sum((rho_H - at.params.flight.formation.desired_position) ** 2, axis=0), _one()


def _relative(at: Instant) -> Observation:
    return jnp.sum(at.errors[1][:3] ** 2, axis=0), _one()


def _servicer(at: Instant) -> Observation:
    return jnp.sum(at.errors[0][:3] ** 2, axis=0), _one()


def _target(at: Instant) -> Observation:
    return jnp.sum((at.errors[0] + at.errors[1])[:3] ** 2, axis=0), _one()


def _nees(at: Instant) -> Observation:
    return at.relative_density[0] + at.servicer_density[0], _one()


def _nees_relative(at: Instant) -> Observation:
    return at.relative_density[0], _one()


def _estimate_surprise(at: Instant) -> Observation:
    terms = (*at.relative_density, *at.servicer_density)
    return 0.5 * (sum(terms[1:], terms[0]) / 12.0 + math.log(2.0 * math.pi)), _one()


def _normalised(at: Instant, rows: slice) -> tuple[Array, Array]:
    found = at.seen.innovation
    return found.innovation[rows] ** 2 / found.variance[rows], found.weight[rows]


def _nis(at: Instant, rows: slice) -> Observation:
    square, weight = _normalised(at, rows)
    return jnp.sum(square, axis=0), jnp.where(jnp.min(weight, axis=0) > 0.5, 1.0, 0.0)


def _innovation_surprise(at: Instant) -> Observation:
    """Minus log density per row, of boxes with a share of false ones, so that no gate decides what is counted."""
    found = at.seen.innovation
    densities = -0.5 * (jnp.log(2.0 * math.pi * found.variance) + found.innovation**2 / found.variance)
    there = jnp.where(found.weight[:3] > 0.5, 1.0, 0.0)
    gps, gps_rows = jnp.sum(there * densities[:3], axis=0), jnp.sum(there, axis=0)
    present = found.accepted | found.rejected
    box = at.seen.frame.box
    used = jnp.stack([_one(), _one(), jnp.where(box.truncated, 0.0, 1.0)])
    focal = at.params.flight.onboard.focal_px
    area = at.scenario.width_px * at.scenario.height_px / focal**2
    false = -jnp.log(area) - used[2] * math.log(_FALSE_BOX_LOG_SIZES)
    real = jnp.sum(used * densities[3:], axis=0)
    mixed = jnp.logaddexp(math.log1p(-FALSE_BOX_SHARE) + real, math.log(FALSE_BOX_SHARE) + false)
    rows = gps_rows + jnp.where(present, jnp.sum(used, axis=0), 0.0)
    total = gps + jnp.where(present, mixed, 0.0)
    return -safe.safe_div(total, rows), rows


def _pointing(at: Instant) -> Observation:
    truth = at.seen.truth
    across = quaternion.cross(telemetry.boresight_N(at.params, truth), safe.normalize(truth.r_ST_N))
    # While the camera looks at the target the angle is small: its sine is it.
    return jnp.rad2deg(1.0) ** 2 * jnp.sum(across**2, axis=0), at.settled


def _range(at: Instant) -> Observation:
    return safe.norm(at.seen.truth.r_ST_N), _one()


def _wheel_speed(at: Instant) -> Observation:
    return jnp.max(jnp.abs(at.seen.truth.wheel_speed / at.params.plant.wheels.speed_limit), axis=0), _one()


def _delta_v(at: Instant) -> Observation:
    return at.seen.truth.delta_v, _one()


FIGURES: Final = {
    "formation_error_rms_m": Figure("m", _formation, "last", "rms"),
    "nav_relative_position_error_rms_m": Figure("m", _relative, "late", "rms"),
    "nav_servicer_position_error_rms_m": Figure("m", _servicer, "late", "rms"),
    "nav_target_position_error_rms_m": Figure("m", _target, "late", "rms"),
    "nees_mean": Figure("-", _nees, "all", "mean"),
    "nees_relative_mean": Figure("-", _nees_relative, "all", "mean"),
    "nis_gps_mean": Figure("-", lambda at: _nis(at, slice(0, 3)), "all", "mean"),
    "nis_box_mean": Figure("-", lambda at: _nis(at, slice(3, 6)), "all", "mean"),
    "innovation_surprise": Figure("-", _innovation_surprise, "all", "mean"),
    "estimate_surprise": Figure("-", _estimate_surprise, "all", "mean"),
    "delta_v_m_s": Figure("m/s", _delta_v, "all", "end"),
    "min_range_m": Figure("m", _range, "all", "min"),
    "wheel_speed_peak_fraction": Figure("-", _wheel_speed, "all", "max"),
    "pointing_error_rms_deg": Figure("deg", _pointing, "late", "rms"),
}
"""Figures by name: `estimate_surprise` is minus the log density of the truth under the estimate per component,
`innovation_surprise` that of the measurements under the filter's prediction per row."""
