"""Definitions of the metrics that are accumulated during the simulation: value and weight at a tick, and reduction."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import mahalanobis_distance, vectors
from rpojax.core.numerics import gradient_safe
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.camera_models import boresight_N
from rpojax.simulation.estimation_errors import orbit_errors
from rpojax.simulation.state import true_relative_state
from rpojax.simulation.telemetry import Telemetry

Scalar = Float[Array, ""]
WeightedValue = tuple[Scalar, Scalar]
"""Value and weight at a tick."""


FALSE_BOX_PROBABILITY: Final = 0.05
"""Prior probability of a false box in `innovation_surprise`, independent of the gate."""


_FALSE_BOX_LOG_SIZE_RANGE: Final = 3.0
"""Range of the log size of false boxes, from a few pixels to the whole frame; the density is uniform."""


@dataclass(frozen=True)
class MetricInputs:
    """Inputs of the metrics at one tick; quantities shared by several metrics are computed once.

    `settled` is 1 if the camera has pointed at the target for at least the settling time, else 0.
    """

    scenario: Scenario
    params: Params
    telemetry: Telemetry
    settled: Scalar

    @cached_property
    def errors(self) -> tuple[Array, Array]:
        """(6,) of the servicer and (6,) of the target relative to it, estimate minus truth in N [m, m/s]."""
        return orbit_errors(self.telemetry)

    @cached_property
    def servicer_density(self) -> tuple[Scalar, Scalar]:
        """Squared Mahalanobis norm of the servicer's error, and log determinant of its covariance."""
        P = self.telemetry.flight.orbit.servicer.covariance[:6, :6]
        return mahalanobis_distance.squared_mahalanobis_and_log_determinant(P, self.errors[0])

    @cached_property
    def relative_density(self) -> tuple[Scalar, Scalar]:
        """Squared Mahalanobis norm of the relative error, and log determinant of its covariance."""
        P = self.telemetry.flight.orbit.relative.covariance[:6, :6]
        return mahalanobis_distance.squared_mahalanobis_and_log_determinant(P, self.errors[1])


@dataclass(frozen=True)
class RunningMetric:
    """Definition of a metric.

    Attributes:
        unit: of the metric
        evaluate: value and weight at a tick
        window: `all` ticks, the `late` ones (from 1000 s or a third of the run on) or the `last` (equally long)
        reduction: weighted `mean` or `rms`, least or greatest value, or the value at the end
    """

    unit: str
    evaluate: Callable[[MetricInputs], WeightedValue]
    window: Literal["all", "late", "last"]
    reduction: Literal["mean", "rms", "min", "max", "end"]


def _unit_weight() -> Scalar:
    return jnp.ones((), dtype=jnp.float64)


def _formation(inputs: MetricInputs) -> WeightedValue:
    rho_H, _ = true_relative_state(inputs.telemetry.truth)
    return jnp.sum((rho_H - inputs.params.flight.formation.desired_position) ** 2, axis=0), _unit_weight()


def _relative(inputs: MetricInputs) -> WeightedValue:
    return jnp.sum(inputs.errors[1][:3] ** 2, axis=0), _unit_weight()


def _servicer(inputs: MetricInputs) -> WeightedValue:
    return jnp.sum(inputs.errors[0][:3] ** 2, axis=0), _unit_weight()


def _target(inputs: MetricInputs) -> WeightedValue:
    return jnp.sum((inputs.errors[0] + inputs.errors[1])[:3] ** 2, axis=0), _unit_weight()


def _nees(inputs: MetricInputs) -> WeightedValue:
    return inputs.relative_density[0] + inputs.servicer_density[0], _unit_weight()


def _nees_relative(inputs: MetricInputs) -> WeightedValue:
    return inputs.relative_density[0], _unit_weight()


def _estimate_negative_log_likelihood(inputs: MetricInputs) -> WeightedValue:
    terms = (*inputs.relative_density, *inputs.servicer_density)
    return 0.5 * (sum(terms[1:], terms[0]) / 12.0 + math.log(2.0 * math.pi)), _unit_weight()


def _normalised_squares(inputs: MetricInputs, rows: slice) -> tuple[Array, Array]:
    innovation = inputs.telemetry.innovation
    return innovation.innovation[rows] ** 2 / innovation.variance[rows], innovation.weight[rows]


def _nis(inputs: MetricInputs, rows: slice) -> WeightedValue:
    square, weight = _normalised_squares(inputs, rows)
    return jnp.sum(square, axis=0), jnp.where(jnp.min(weight, axis=0) > 0.5, 1.0, 0.0)


def _innovation_negative_log_likelihood(inputs: MetricInputs) -> WeightedValue:
    """Negative log likelihood per row, with a mixture of true and false boxes in place of the gate."""
    innovation = inputs.telemetry.innovation
    log_densities = -0.5 * (
        jnp.log(2.0 * math.pi * innovation.variance) + innovation.innovation**2 / innovation.variance
    )
    used_gps = jnp.where(innovation.weight[:3] > 0.5, 1.0, 0.0)
    gps, gps_rows = jnp.sum(used_gps * log_densities[:3], axis=0), jnp.sum(used_gps, axis=0)
    present = innovation.accepted | innovation.rejected
    box = inputs.telemetry.frame.box
    used_box = jnp.stack([_unit_weight(), _unit_weight(), jnp.where(box.truncated, 0.0, 1.0)])
    focal = inputs.params.flight.vehicle.focal_px
    area = inputs.scenario.width_px * inputs.scenario.height_px / focal**2
    false_box = -jnp.log(area) - used_box[2] * math.log(_FALSE_BOX_LOG_SIZE_RANGE)
    true_box = jnp.sum(used_box * log_densities[3:], axis=0)
    mixture = jnp.logaddexp(math.log1p(-FALSE_BOX_PROBABILITY) + true_box, math.log(FALSE_BOX_PROBABILITY) + false_box)
    rows = gps_rows + jnp.where(present, jnp.sum(used_box, axis=0), 0.0)
    total = gps + jnp.where(present, mixture, 0.0)
    return -gradient_safe.safe_div(total, rows), rows


def _pointing(inputs: MetricInputs) -> WeightedValue:
    truth = inputs.telemetry.truth
    across = vectors.cross(boresight_N(inputs.params, truth), gradient_safe.normalize(truth.r_ST_N))
    # The angle is small while the camera points at the target: its sine approximates it.
    return jnp.rad2deg(1.0) ** 2 * jnp.sum(across**2, axis=0), inputs.settled


def _range(inputs: MetricInputs) -> WeightedValue:
    return gradient_safe.norm(inputs.telemetry.truth.r_ST_N), _unit_weight()


def _wheel_speed(inputs: MetricInputs) -> WeightedValue:
    fraction = inputs.telemetry.truth.wheel_speed / inputs.params.plant.wheels.speed_limit
    return jnp.max(jnp.abs(fraction), axis=0), _unit_weight()


def _delta_v(inputs: MetricInputs) -> WeightedValue:
    return inputs.telemetry.truth.delta_v, _unit_weight()


RUNNING_METRICS: Final = {
    "formation_error_rms_m": RunningMetric("m", _formation, "last", "rms"),
    "nav_relative_position_error_rms_m": RunningMetric("m", _relative, "late", "rms"),
    "nav_servicer_position_error_rms_m": RunningMetric("m", _servicer, "late", "rms"),
    "nav_target_position_error_rms_m": RunningMetric("m", _target, "late", "rms"),
    "nees_mean": RunningMetric("-", _nees, "all", "mean"),
    "nees_relative_mean": RunningMetric("-", _nees_relative, "all", "mean"),
    "nis_gps_mean": RunningMetric("-", lambda inputs: _nis(inputs, slice(0, 3)), "all", "mean"),
    "nis_box_mean": RunningMetric("-", lambda inputs: _nis(inputs, slice(3, 6)), "all", "mean"),
    "innovation_surprise": RunningMetric("-", _innovation_negative_log_likelihood, "all", "mean"),
    "estimate_surprise": RunningMetric("-", _estimate_negative_log_likelihood, "all", "mean"),
    "delta_v_m_s": RunningMetric("m/s", _delta_v, "all", "end"),
    "min_range_m": RunningMetric("m", _range, "all", "min"),
    "wheel_speed_peak_fraction": RunningMetric("-", _wheel_speed, "all", "max"),
    "pointing_error_rms_deg": RunningMetric("deg", _pointing, "late", "rms"),
}
"""Metrics by name.

`estimate_surprise` is the negative log likelihood of the truth under the estimate per component, `innovation_surprise`
that of the measurements under the prediction of the filter per row.
"""
