"""Diagnostics of a measurement in the orbit filter, in one form for all sensors."""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.kalman_update import KalmanUpdate, MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree

FIXED: Final = ("gps", "box")
"""Names of the sensors that every orbit filter has, besides those of `believed_sensor`."""


@pytree
class SensorInnovation:
    """Diagnostics of a measurement.

    Attributes:
        innovation: (m,) of each row given the rows before it
        variance: (m,) its variance by the filter
        used: (m,) bool, rows that were used
        log_likelihood: () of the rows used
        accepted: () bool, the measurement was used
        rejected: () bool, there was one and it was not used
        rows: those of an additional sensor's update, with the weights that the gate gave, as of a state of zero
    """

    innovation: Array
    variance: Array
    used: Array
    log_likelihood: Array
    accepted: Array
    rejected: Array
    rows: MeasurementRows | None = None

    @property
    def sigmas(self) -> Float[Array, " m"]:
        """Innovations divided by their sigma; NaN for rows that were not used."""
        return jnp.where(self.used, self.innovation / gradient_safe.sqrt(self.variance), jnp.nan)


def of_update(
    result: KalmanUpdate, present: Bool[Array, ""], accepted: Bool[Array, ""], rows: MeasurementRows | None = None
) -> SensorInnovation:
    """Diagnostics of the update by a measurement, if it was `present`, and whether the gate `accepted` it."""
    return SensorInnovation(
        innovation=result.innovation,
        variance=result.innovation_variance,
        used=result.used,
        log_likelihood=result.log_likelihood,
        accepted=accepted,
        rejected=present & ~accepted,
        rows=rows,
    )
