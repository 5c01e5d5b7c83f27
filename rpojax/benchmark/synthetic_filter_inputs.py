"""Synthetic inputs of the orbit filter: GPS and boxes of the nominal orbits, with the camera pointed at the target."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.batching import batching_mode
from rpojax.campaign import single_run
from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import target_pointing
from rpojax.flight.navigation import combined_orbit_filter, lasting_error_effects
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement
from rpojax.physics import plant_state
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario

NOISES_PER_UPDATE = 6
"""Standard normal numbers per second: GPS, centre and size of the box."""
_HALF_FRAME = 0.1


@pytree
class FilterInputs:
    """Inputs of the filter for one second.

    Attributes:
        delta_v_N: (3,) velocity change of a burn in it [m/s]
        burn_delta_v: () velocity change of the whole burn [m/s]
        covariance_inflation: () factor on the execution error
        third_body_acceleration_N: (3,) of the Sun and the Moon [m/s^2]
        q_KN: (4,) attitude of the camera
        gps: position
        box: bounding box
    """

    delta_v_N: Array
    burn_delta_v: Array
    covariance_inflation: Array
    third_body_acceleration_N: Array
    q_KN: Array
    gps: GpsMeasurement
    box: BoxMeasurement


def nominal_setup(file: ScenarioFile) -> tuple[Scenario, FlightParams, OrbitEstimate]:
    """Static settings, parameters of the flight software, and the nominal initial orbits as an exact estimate."""
    # Kernels are measured in double precision, independently of the scenario's.
    scenario, params = single_run.nominal_parameters(file.model_copy(update={"precision": "double"}))
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], dtype=jnp.float64)
    initial = params.initial
    true = plant_state.initial_truth(
        params.plant, params.orbit, initial.relative_position, initial.relative_velocity, identity
    )
    servicer = (true.r_TN_N + true.r_ST_N, true.v_TN_N + true.v_ST_N)
    return (
        scenario,
        params.flight,
        combined_orbit_filter.initial(params.flight.navigation, *servicer, -true.r_ST_N, -true.v_ST_N),
    )


def propagate_truth(scenario: Scenario, flight: FlightParams, truth: OrbitEstimate) -> OrbitEstimate:
    """True orbits a second later, by the prediction of the filter."""
    zero, none = jnp.zeros((), dtype=jnp.float64), jnp.zeros(3, dtype=jnp.float64)
    degree, dt = scenario.navigation_zonal_degree, scenario.tick_s
    return combined_orbit_filter.predict(
        flight.navigation, degree, truth, none, zero, zero + 1.0, none, lasting_error_effects.none(), dt
    )


def synthetic_measurements(
    interval: float, flight: FlightParams, truth: OrbitEstimate, noise: Float[Array, "6"]
) -> FilterInputs:
    """Measurements of true orbits every `interval` [s], with standard normal noise (6,)."""
    tuning, focal = flight.navigation, flight.vehicle.focal_px
    q_BN, _ = target_pointing.look_attitude(flight.vehicle, truth)
    r_TS_N = truth.relative.r_TS_N
    angle = tuning.target_size / gradient_safe.norm(r_TS_N)
    pixel = tuning.edge_noise / focal
    zero, none, yes = jnp.zeros_like(angle), jnp.zeros_like(r_TS_N), jnp.ones_like(angle, dtype=bool)
    return FilterInputs(
        delta_v_N=none,
        burn_delta_v=zero,
        covariance_inflation=zero + 1.0,
        third_body_acceleration_N=none,
        q_KN=quaternion.multiply(quaternion.normalize(flight.vehicle.camera_mounting), q_BN),
        gps=GpsMeasurement(position_N=truth.servicer.r_SN_N + tuning.gps_noise * noise[:3], present=yes),
        box=BoxMeasurement(
            tangent=pixel * noise[3:5],
            log_size=jnp.log(angle) + pixel / angle * noise[5],
            log_aspect=zero,
            side_px=angle * focal,
            present=yes,
            expected=yes,
            truncated=~yes,
            half_frame_tangent=jnp.full(2, _HALF_FRAME, dtype=jnp.float64),
            attitude_variance_change=zero,
            interval=zero + interval,
        ),
    )


def simulate_measurements(
    scenario: Scenario, flight: FlightParams, start: OrbitEstimate, noise: Float[Array, "t 6 n"]
) -> tuple[OrbitEstimate, FilterInputs]:
    """True orbits at the end, and the measurements of all runs, time first and runs last."""
    batched_measurements = batch_last_axis(partial(synthetic_measurements, scenario.tick_s), (None, None, -1))

    def second(truth: OrbitEstimate, noise: Array) -> tuple[OrbitEstimate, FilterInputs]:
        after = propagate_truth(scenario, flight, truth)
        return after, batched_measurements(flight, after, noise)

    return jax.lax.scan(second, start, noise)


def batch_last_axis(function: Callable[..., Any], in_axes: tuple[int | None, ...]) -> Callable[..., Any]:
    """A function of one run, batched over the last axes of its arguments and results."""
    return batching_mode.transform()(function, in_axes, -1)
