"""A servicer 30 m behind its target: synthetic estimates, camera attitude and box measurements for flight software."""

import jax
import jax.numpy as jnp
import numpy as np
from numpy_reference import MU, unit

from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FilterSettings, FlightParams
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.guidance import target_pointing
from rpojax.flight.guidance.attitude_guidance import PointingState
from rpojax.flight.guidance.detector_window import CameraFormat
from rpojax.flight.mission.static_mission_settings import MissionSettings, PhaseSettings
from rpojax.flight.navigation import combined_orbit_filter
from rpojax.flight.navigation.box_measurement import outlier_gate
from rpojax.flight.navigation.box_measurement.outlier_gate import GateState
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.stages import Stages
from rpojax.flight.vehicle_model import VehicleModel

R_SN_N = np.array([5.0e6, 3.0e6, 3.7e6])
"""Position of the servicer [m], 6900 km from the Earth's centre."""

V_SN_N = np.sqrt(MU / np.linalg.norm(R_SN_N)) * unit(np.cross([0.3, -0.5, 0.8], R_SN_N))
"""Velocity of the servicer on a circular orbit [m/s]."""

TARGET_AHEAD = 30.0 * unit(V_SN_N)
"""Position of the target from the servicer, 30 m along the velocity [m]."""

HILL_RATE = np.cross(R_SN_N, V_SN_N) / (R_SN_N @ R_SN_N)
"""Rate of the servicer's Hill frame in N components [rad/s]."""

SUN_OVERHEAD = 1.5e11 * unit(R_SN_N)
"""Position of the Sun at the zenith [m]: the target is lit at a phase angle of 90 deg."""

SUN_BEHIND_EARTH = -SUN_OVERHEAD
"""Position of the Sun behind the Earth [m]."""

_initial = jax.jit(combined_orbit_filter.initial)


SMALL_CAMERA = CameraFormat(width_px=128, height_px=128, input_px=128)


def software(
    flight: FlightParams,
    stages: Stages | None = None,
    camera: CameraFormat = SMALL_CAMERA,
    formation_period_s: float = 200.0,
) -> FlightSoftware:
    """Flight software that holds a station, at one tick a second."""
    ticks = round(formation_period_s)
    return FlightSoftware(
        stages=stages or Stages(),
        params=flight,
        filter=FilterSettings(gated=True, zonal_degree=2),
        camera=camera,
        mission=MissionSettings(
            phases=(
                PhaseSettings(
                    name="station",
                    pointing="target",
                    control_ticks=ticks,
                    burns_per_orbit=1,
                    on_timeout="hold",
                    ends=False,
                    has_arrival_box=False,
                    passively_safe=False,
                    has_corridor=False,
                    stops_in_the_dark=True,
                ),
            ),
            is_managed=False,
            decision_ticks=ticks,
            hold_ticks=ticks,
            hold_burns_per_orbit=1,
        ),
        tick_s=1.0,
    )


@jax.jit
def _camera_attitude(vehicle: VehicleModel, orbit_estimate: OrbitEstimate) -> jax.Array:
    q_BN, _ = target_pointing.look_attitude(vehicle, orbit_estimate)
    return quaternion.multiply(quaternion.normalize(vehicle.camera_mounting), q_BN)


def estimate(
    flight: FlightParams,
    r_TS_N: np.ndarray = TARGET_AHEAD,
    v_TS_N: np.ndarray | None = None,
    position_sigma: float = 0.2,
    velocity_sigma: float = 1e-3,
) -> OrbitEstimate:
    """Orbit estimate with the given relative state (by default at rest in the Hill frame) and sigmas."""
    drift = np.cross(HILL_RATE, r_TS_N) if v_TS_N is None else v_TS_N
    navigation = replace(
        flight.navigation,
        initial_relative_position_sigma=jnp.float64(position_sigma),
        initial_relative_velocity_sigma=jnp.float64(velocity_sigma),
    )
    return _initial(navigation, R_SN_N, V_SN_N, r_TS_N, drift)


def camera_attitude(flight: FlightParams, orbit_estimate: OrbitEstimate) -> np.ndarray:
    """`q_KN` of a camera whose boresight points at the estimated target."""
    return np.asarray(_camera_attitude(flight.vehicle, orbit_estimate))


def box(
    flight: FlightParams, R_KN: np.ndarray, r_TS_N: np.ndarray, present: bool = True, truncated: bool = False
) -> BoxMeasurement:
    """Box measurement without error of a target of the expected size at `r_TS_N` [m]."""
    r_K = R_KN @ r_TS_N
    size = float(flight.navigation.target_size) / np.linalg.norm(r_TS_N)
    return BoxMeasurement(
        tangent=jnp.asarray(r_K[:2] / r_K[2]),
        log_size=jnp.float64(np.log(size)),
        log_aspect=jnp.zeros(()),
        side_px=jnp.float64(size * float(flight.vehicle.focal_px)),
        present=jnp.asarray(present),
        expected=jnp.asarray(True),
        truncated=jnp.asarray(truncated),
        half_frame_tangent=jnp.full(2, np.tan(np.deg2rad(5.0))),
        attitude_variance_change=jnp.zeros(()),
        interval=jnp.ones(()),
    )


def gate_after_a_box() -> GateState:
    """Gate state with a box on the target one frame ago, cut by the frame."""
    before = outlier_gate.initial()
    return replace(
        before,
        direction_N=before.direction_N.at[:, 0].set(unit(TARGET_AHEAD)),
        truncated=before.truncated.at[0].set(True),
        age=before.age.at[0].set(1.0),
    )


def with_acquisition(pointing: PointingState, **changes: jax.Array) -> PointingState:
    """State of the attitude guidance with some fields of its acquisition changed."""
    return replace(pointing, acquisition=replace(pointing.acquisition, **changes))
