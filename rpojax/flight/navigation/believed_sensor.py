"""Measurements of additional sensors in the relative filter: what a sensor says of them, their gate, their update.

A sensor is believed if its class says which rows its measurement gives. Each measurement passes a gate of its own. A
sensor that is rejected for long, while nothing else measures the target, widens the estimate.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update
from rpojax.core.filter_state_layout import StateLayout
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError
from rpojax.flight.navigation import relative_filter_state
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.sensor_innovation import SensorInnovation
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget
from rpojax.flight.vehicle_model import VehicleModel


@dataclass(frozen=True)
class SensorView:
    """What flight software knows where it uses a measurement.

    Attributes:
        tuning: of the orbit filter
        relative: estimate of the target before the measurement
        q_BN: (4,) attitude of the servicer by the attitude filter
        time: () since the start of the run [s]
        vehicle: the servicer as flight software believes it, with the lens in use; None outside of the closed loop
        target: the target likewise, None unless a sensor shows its attitude
    """

    tuning: OrbitFilterTuning
    relative: RelativeEstimate
    q_BN: Array
    time: Array
    vehicle: VehicleModel | None = None
    target: BelievedTarget | None = None

    @property
    def layout(self) -> StateLayout:
        """Names of the blocks of the filter's state."""
        return self.relative.layout

    def rows(
        self,
        expected: Callable[[RelativeEstimate], Float[Array, " m"]],
        measured: Float[Array, " m"],
        variance: Float[Array, " m"],
        present: Bool[Array, ""],
    ) -> MeasurementRows:
        """Rows of a measurement with independent noise, linearised at the estimate.

        Args:
            expected: measurement (m,) of an estimate without noise, differentiable
            measured: (m,) the measurement; what it holds where there is none does not count
            variance: (m,) of its noise
            present: () bool, there is one
        """
        estimate = self.relative

        def at(vector: Array) -> Array:
            return expected(relative_filter_state.moved_to(estimate, vector, estimate.covariance))

        if (shape := jnp.shape(values := expected(estimate))) != jnp.shape(measured):
            raise RpojaxError(f"rows: found expected of shape {shape}, expected {jnp.shape(measured)} as measured")
        return MeasurementRows(
            residual=jnp.where(present, measured, 0.0) - values,
            jacobian=jax.jacfwd(at)(estimate.vector),
            variance=variance,
            weight=jnp.full(measured.shape, jnp.where(present, 1.0, 0.0)),
        )


BelievedRows = Callable[[Mapping[str, Array], SensorView, Mapping[str, Array]], MeasurementRows]
"""Rows of a sensor from the numbers that flight software believes of it, a view, and all measurements by name."""
SensorRows = Callable[[RelativeEstimate], MeasurementRows]
"""The same for one estimate, with all else bound."""


@dataclass(frozen=True)
class BelievedSensor:
    """An additional sensor that the filter believes.

    Attributes:
        name: of the sensor
        rows: of a measurement
        count: number of its rows
    """

    name: str
    rows: BelievedRows
    count: int

    def checked_rows(
        self, beliefs: Mapping[str, Array], view: SensorView, measured: Mapping[str, Array]
    ) -> MeasurementRows:
        """Rows of a measurement.

        Raises:
            RpojaxError: they are not as many as the class says, or of another shape.
        """
        found = self.rows(beliefs, view, measured)
        for part in ("residual", "jacobian", "variance", "weight"):
            shape = (self.count, view.layout.size) if part == "jacobian" else (self.count,)
            if (is_shape := jnp.shape(getattr(found, part))) != shape:
                raise RpojaxError(f"sensors.{self.name}.rows: found {part} of shape {is_shape}, expected {shape}")
        return found


def update(
    tuning: OrbitFilterTuning, gated: bool, estimate: RelativeEstimate, rows: MeasurementRows
) -> tuple[RelativeEstimate, SensorInnovation]:
    """Estimate after a measurement that passes the gate, and its diagnostics.

    A row that holds what is no number does not count.
    """
    rows = _present(rows)
    weight, present = _gate_weight(tuning, gated, estimate, rows), rows.weight > 0.5
    gated_rows = replace(rows, weight=rows.weight * weight)
    result = kalman_update.update(estimate.covariance, gated_rows)
    as_of_zero = replace(gated_rows, residual=gated_rows.residual + _along(rows, estimate.vector))
    innovation = SensorInnovation.of_update(result, jnp.any(present, axis=0), jnp.any(result.used, axis=0), as_of_zero)
    return relative_filter_state.corrected(estimate, result.deviation, result.covariance), innovation


def rows_of(innovations: Mapping[str, SensorInnovation]) -> MeasurementRows | None:
    """Rows of all additional sensors, for filters of which the same estimate is a part; None without one."""
    rows = [each.rows for each in innovations.values() if each.rows is not None]
    return jax.tree.map(lambda *parts: jnp.concatenate(parts), *rows) if rows else None


def at_estimate(rows: MeasurementRows, estimate: RelativeEstimate) -> MeasurementRows:
    """Rows as of a state of zero, with the residuals of an estimate."""
    return replace(rows, residual=rows.residual - _along(rows, estimate.vector))


def _along(rows: MeasurementRows, vector: Float[Array, " n"]) -> Float[Array, " m"]:
    return jnp.sum(rows.jacobian * vector[None, :], axis=1)


def _present(rows: MeasurementRows) -> MeasurementRows:
    """Rows with numbers throughout, and no weight where there was another thing."""
    numbers = jnp.isfinite(rows.residual) & jnp.isfinite(rows.variance) & jnp.all(jnp.isfinite(rows.jacobian), axis=1)
    counts = numbers & (rows.weight > 0.5)
    return MeasurementRows(
        residual=jnp.where(counts, rows.residual, 0.0),
        jacobian=jnp.where(counts[:, None], rows.jacobian, 0.0),
        variance=jnp.where(counts, rows.variance, 1.0),
        weight=jnp.where(counts, rows.weight, 0.0),
    )


def _gate_weight(tuning: OrbitFilterTuning, gated: bool, estimate: RelativeEstimate, rows: MeasurementRows) -> Array:
    """1 if all rows that are present are within the gate, else 0, with the derivative of a smooth gate."""
    if not gated:
        return jnp.ones_like(rows.residual[0])
    products = jnp.sum(estimate.covariance[None] * rows.jacobian[:, None, :], axis=2)
    variance = jnp.sum(products * rows.jacobian, axis=1) + rows.variance
    ratio = rows.residual**2 / variance
    margin = tuning.gate_sigma**2 - jnp.max(ratio, axis=0)
    return gradient_safe.gate(margin, tuning.gate_slope_width)
