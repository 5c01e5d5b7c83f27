"""Extended Kalman filter of the servicer's orbit, with GPS positions as measurements.

State: position and velocity of the servicer in N, and the slowly varying error of GPS.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import kalman_update
from rpojax.core.filter_state_layout import MOTION, StateLayout
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.numerics import double_single
from rpojax.core.pytree import pytree, replace
from rpojax.flight.navigation import orbit_covariance
from rpojax.flight.navigation.orbit_covariance import OrbitStep
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import GpsMeasurement
from rpojax.flight.navigation.sensor_innovation import SensorInnovation

Vector = Float[Array, "3"]

LAYOUT = StateLayout((*MOTION.blocks, ("gps_error", 3)))


@pytree
class ServicerEstimate:
    """Mean and covariance of the servicer's orbit.

    Attributes:
        r_SN_N: (3,) servicer position [m]
        v_SN_N: (3,) servicer velocity [m/s]
        gps_error_N: (3,) [m]
        covariance: (9, 9) in this order, that of `LAYOUT`
        orbit_low: (2, 3) low-order parts of position [m] and velocity [m/s] in single precision; else None
    """

    r_SN_N: Array
    v_SN_N: Array
    gps_error_N: Array
    covariance: Array
    orbit_low: Array | None = None

    @property
    def motion_covariance(self) -> Float[Array, "6 6"]:
        """Covariance of position and velocity [m, m/s]."""
        return self.covariance[: MOTION.size, : MOTION.size]


def initial_sigma(tuning: OrbitFilterTuning) -> Float[Array, "9"]:
    """1-sigma of every state at hand-over."""
    return LAYOUT.vector(
        position=jnp.full(3, tuning.initial_position_sigma),
        velocity=jnp.full(3, tuning.initial_velocity_sigma),
        gps_error=jnp.full(3, tuning.gps_error_sigma),
    )


def initial(tuning: OrbitFilterTuning, r_SN_N: Vector, v_SN_N: Vector) -> ServicerEstimate:
    """Estimate at hand-over with position [m] and velocity [m/s] as means."""
    return ServicerEstimate(
        r_SN_N=r_SN_N,
        v_SN_N=v_SN_N,
        gps_error_N=jnp.zeros_like(r_SN_N),
        covariance=jnp.diag(initial_sigma(tuning) ** 2),
    )


def predict(tuning: OrbitFilterTuning, moved: ServicerEstimate, step: OrbitStep) -> ServicerEstimate:
    """Estimate after a step, of which the orbit has `moved` already."""
    decay = jnp.exp(-step.dt / tuning.gps_error_time_constant)
    gps_error_process_variance = tuning.gps_error_sigma**2 * (1.0 - decay**2)
    return replace(
        moved,
        gps_error_N=decay * moved.gps_error_N,
        covariance=orbit_covariance.propagate(
            moved.covariance,
            step.with_acceleration_noise(tuning.acceleration_noise),
            jnp.full(3, decay),
            jnp.full(3, gps_error_process_variance),
        ),
    )


def update(
    tuning: OrbitFilterTuning, estimate: ServicerEstimate, gps: GpsMeasurement
) -> tuple[ServicerEstimate, SensorInnovation]:
    """Estimate after a GPS position, unchanged if there is none, and diagnostics."""
    position_low = None if estimate.orbit_low is None else estimate.orbit_low[0]
    difference = double_single.subtract(gps.position_N, gps.position_low_N, estimate.r_SN_N, position_low)
    identity = jnp.eye(3, dtype=difference.dtype)
    rows = MeasurementRows(
        residual=difference - estimate.gps_error_N,
        jacobian=LAYOUT.rows(position=identity, gps_error=identity),
        variance=jnp.full(3, tuning.gps_noise**2),
        weight=jnp.full(3, jnp.where(gps.present, 1.0, 0.0)),
    )
    P = estimate.covariance
    result = kalman_update.update(P, rows, HP=P[LAYOUT["position"]] + P[LAYOUT["gps_error"]])
    x = LAYOUT.split(result.deviation)
    r_SN_N, v_SN_N, orbit_low = double_single.add_to_state(
        estimate.r_SN_N, estimate.v_SN_N, estimate.orbit_low, x["position"], x["velocity"]
    )
    corrected = ServicerEstimate(
        r_SN_N=r_SN_N,
        v_SN_N=v_SN_N,
        orbit_low=orbit_low,
        gps_error_N=estimate.gps_error_N + x["gps_error"],
        covariance=result.covariance,
    )
    return corrected, SensorInnovation.of_update(result, gps.present, gps.present)
