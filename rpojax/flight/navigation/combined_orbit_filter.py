"""Orbit filter: two extended Kalman filters of servicer and relative orbit, with GPS and bounding boxes.

The state is the servicer's orbit and the target relative to it, so no two 7000 km vectors are ever subtracted. GPS
updates the first half, the box the second. The two halves have separate covariances: gravity does not couple
them (a metre of servicer error changes the relative acceleration by 1e-13 m/s^2), and the execution error of a burn,
which enters both, is a tenth of a millimetre per second against the servicer's several. The target's own covariance is
the sum of the two.
"""

import functools
import operator
from collections.abc import Iterable, Mapping

from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import runge_kutta
from rpojax.core.orbits import encke_reference
from rpojax.core.orbits.zonal_gravity import EARTH_GRAVITY
from rpojax.core.pytree import pytree, replace
from rpojax.flight.navigation import (
    believed_sensor,
    burn_execution_error,
    relative_filter_state,
    relative_orbit_ekf,
    retrodiction,
    servicer_orbit_ekf,
)
from rpojax.flight.navigation.believed_sensor import SensorRows
from rpojax.flight.navigation.box_measurement.box_measurement_model import ExpectedBox
from rpojax.flight.navigation.box_measurement.outlier_gate import GateState
from rpojax.flight.navigation.lasting_error_effects import LastingEffects
from rpojax.flight.navigation.orbit_covariance import OrbitStep
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement, box_view
from rpojax.flight.navigation.relative_filter_state import SLOW_STATES, RelativeEstimate, SlowState
from rpojax.flight.navigation.retrodiction import Exposure
from rpojax.flight.navigation.sensor_innovation import SensorInnovation
from rpojax.flight.navigation.servicer_orbit_ekf import ServicerEstimate
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class OrbitEstimate:
    """Estimates of the servicer's orbit and of the target relative to it."""

    servicer: ServicerEstimate
    relative: RelativeEstimate


@pytree
class Innovation:
    """Diagnostics of an update.

    Attributes:
        sensors: of each sensor by name: `gps`, `box`, and the additional ones that the filter believes
        expected_box: box expected before the measurement
    """

    sensors: dict[str, SensorInnovation]
    expected_box: ExpectedBox

    def is_used(self, sensors: Iterable[str]) -> Bool[Array, ""]:
        """Whether a measurement of one of these sensors was used."""
        return functools.reduce(operator.or_, (self.sensors[name].accepted for name in sensors))


def initial(
    tuning: OrbitFilterTuning,
    r_SN_N: Vector,
    v_SN_N: Vector,
    r_TS_N: Vector,
    v_TS_N: Vector,
    slow_states: tuple[SlowState, ...] = SLOW_STATES,
    target: BelievedTarget | None = None,
) -> OrbitEstimate:
    """Estimate at hand-over with positions [m] and velocities [m/s] as means, and these slow states of the target.

    With `target` its attitude is estimated, too.
    """
    return OrbitEstimate(
        servicer=servicer_orbit_ekf.initial(tuning, r_SN_N, v_SN_N),
        relative=relative_filter_state.initial(tuning, r_TS_N, v_TS_N, slow_states, target),
    )


def predict(
    tuning: OrbitFilterTuning,
    zonal_degree: int,
    estimate: OrbitEstimate,
    delta_v_N: Vector,
    burn_delta_v: Scalar,
    burn_sigma_inflation: Scalar,
    third_body_acceleration_N: Vector,
    lasting: LastingEffects,
    dt: float,
) -> OrbitEstimate:
    """Estimate `dt` [s] later, with the known velocity change [m/s] spread over the step.

    `burn_delta_v` [m/s] is the size of the whole burn that `delta_v_N` is a part of, `burn_sigma_inflation` [-] a
    factor on the tuning's sigma of burn magnitude, `third_body_acceleration_N` [m/s^2] that of the servicer by Sun and
    Moon, `lasting` the effect of errors that last.
    """
    servicer, relative = estimate.servicer, estimate.relative
    effects = relative_filter_state.velocity_effects(relative.layout, lasting, delta_v_N, dt)
    delta_v_N = relative_filter_state.expected_delta_v(relative, lasting, delta_v_N)
    acceleration = delta_v_N / dt
    pushed_apart = relative_filter_state.lasting_acceleration(relative, lasting) - acceleration
    reference = encke_reference.reference_orbit(
        EARTH_GRAVITY, zonal_degree, servicer.r_SN_N, servicer.v_SN_N, servicer.orbit_low
    )

    def derivative(y: tuple[Vector, ...], time: Scalar | None) -> tuple[Vector, ...]:
        r, v, d, d_dot = y
        gravity = reference.gravity(time, r, d)
        return (
            v,
            gravity.value + third_body_acceleration_N + acceleration,
            d_dot,
            gravity.change + pushed_apart,
        )

    mean = (*reference.integration_start, relative.r_TS_N, relative.v_TS_N)
    times = reference.node_times(runge_kutta.NODES["rk4"], dt)
    change_r, change_v, change_d, change_d_dot = runge_kutta.increment("rk4", derivative, mean, times, dt)
    r, v, orbit_low = reference.final_state(dt, change_r, change_v)
    relative = replace(relative, r_TS_N=relative.r_TS_N + change_d, v_TS_N=relative.v_TS_N + change_d_dot)
    new, whole = burn_execution_error.new_and_whole(tuning, delta_v_N, burn_delta_v, burn_sigma_inflation)
    step = OrbitStep(
        dt=dt,
        r_SN_N=servicer.r_SN_N,
        velocity_covariance=new,
        velocity_effects=effects,
    )
    servicer = replace(servicer, r_SN_N=r, v_SN_N=v, orbit_low=orbit_low)
    # The servicer's own estimate, which GPS keeps, takes all of a burn's error as new.
    of_servicer = replace(step, velocity_covariance=whole, velocity_effects=None)
    return OrbitEstimate(
        servicer=servicer_orbit_ekf.predict(tuning, servicer, of_servicer),
        relative=relative_orbit_ekf.predict(tuning, relative, step),
    )


def update(
    tuning: OrbitFilterTuning,
    gated: bool,
    focal_px: Scalar,
    estimate: OrbitEstimate,
    gate: GateState,
    gps: GpsMeasurement,
    q_KN: Float[Array, "4"],
    box: BoxMeasurement,
    sensors: Mapping[str, SensorRows] | None = None,
    exposures: Mapping[str, Exposure] | None = None,
) -> tuple[OrbitEstimate, GateState, Innovation]:
    """Estimate after GPS, the box and the `sensors`, as far as present and within their gates; gate; diagnostics.

    `q_KN` is the camera's attitude by the attitude filter. With an exposure of `camera` or a sensor the estimate is
    updated as of then.
    """
    servicer, of_gps = servicer_orbit_ekf.update(tuning, estimate.servicer, gps)
    exposures = exposures or {}
    relative = retrodiction.to_exposure(estimate.relative, exposures.get("camera"))
    relative, gate, of_box, expected = relative_orbit_ekf.update(
        tuning, gated, relative, gate, box_view(box, focal_px, q_KN)
    )
    relative = retrodiction.from_exposure(relative, exposures.get("camera"))
    found = {"gps": of_gps, "box": of_box}
    for name, rows in (sensors or {}).items():
        relative = retrodiction.to_exposure(relative, exposures.get(name))
        relative, found[name] = believed_sensor.update(tuning, gated, relative, rows(relative))
        relative = retrodiction.from_exposure(relative, exposures.get(name))
    estimate = OrbitEstimate(servicer=servicer, relative=relative)
    return estimate, gate, Innovation(sensors=found, expected_box=expected)
