"""Diagnostics of a measurement in the orbit filter, in one form for all sensors."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.kalman_update import KalmanUpdate, MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree


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
        rows: of an additional sensor, with the weights that the gate gave, as of a state of zero; None of GPS and box
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

    @classmethod
    def of_update(
        cls,
        result: KalmanUpdate,
        present: Bool[Array, ""],
        accepted: Bool[Array, ""],
        rows: MeasurementRows | None = None,
    ) -> "SensorInnovation":
        """Diagnostics of an update by a measurement, if it was `present`, and whether its gate `accepted` it."""
        return cls(
            innovation=result.innovation,
            variance=result.innovation_variance,
            used=result.used,
            log_likelihood=result.log_likelihood,
            accepted=accepted,
            rejected=present & ~accepted,
            rows=rows,
        )
