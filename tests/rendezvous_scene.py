"""A servicer behind its target, as the flight software knows it: estimates, camera attitude and boxes for the tests."""

import jax
import jax.numpy as jnp
import numpy as np
from numpy_reference import MU, unit

from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.flight.computer import FlightParams
from rpojax.flight.guidance import target_pointing
from rpojax.flight.navigation import orbit_filter
from rpojax.flight.navigation.filter_tuning import BoxMeasurement
from rpojax.flight.navigation.orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import VehicleModel

R_SN_N = np.array([5.0e6, 3.0e6, 3.7e6])
"""Position of the servicer [m], 6900 km from the Earth's centre."""

V_SN_N = np.sqrt(MU / np.linalg.norm(R_SN_N)) * unit(np.cross([0.3, -0.5, 0.8], R_SN_N))
"""Its velocity on a circular orbit [m/s]."""

TARGET_AHEAD = 30.0 * unit(V_SN_N)
"""The target 30 m ahead of it [m]."""

HILL_RATE = np.cross(R_SN_N, V_SN_N) / (R_SN_N @ R_SN_N)
"""Rate of its Hill frame, inertial components [rad/s]."""

SUN_OVERHEAD = 1.5e11 * unit(R_SN_N)
"""The Sun overhead [m]: the target is lit and a quarter of it lies in its own shade."""

SUN_BEHIND_EARTH = -SUN_OVERHEAD
"""The Sun behind the Earth [m]."""


_initial = jax.jit(orbit_filter.initial)


@jax.jit
def _camera_attitude(onboard: VehicleModel, known: OrbitEstimate) -> jax.Array:
    q_BN, _ = target_pointing.look_attitude(onboard, known)
    return quaternion.multiply(quaternion.normalize(onboard.camera_mounting), q_BN)


def estimate(
    flight: FlightParams,
    r_TS_N: np.ndarray = TARGET_AHEAD,
    v_TS_N: np.ndarray | None = None,
    position_sigma: float = 0.2,
    velocity_sigma: float = 1e-3,
) -> OrbitEstimate:
    """Estimate with the target at rest in the Hill frame, unless told, and as certain as told."""
    drift = np.cross(HILL_RATE, r_TS_N) if v_TS_N is None else v_TS_N
    navigation = replace(
        flight.navigation,
        initial_relative_position_sigma=jnp.float64(position_sigma),
        initial_relative_velocity_sigma=jnp.float64(velocity_sigma),
    )
    return _initial(navigation, R_SN_N, V_SN_N, r_TS_N, drift)


def camera_attitude(flight: FlightParams, known: OrbitEstimate) -> np.ndarray:
    """`q_KN` of a camera that looks straight at the estimated target."""
    return np.asarray(_camera_attitude(flight.vehicle, known))


def box(
    flight: FlightParams, R_KN: np.ndarray, r_TS_N: np.ndarray, present: bool = True, truncated: bool = False
) -> BoxMeasurement:
    """The box that a target of the expected size at `r_TS_N` [m] gives without any error."""
    r_K = R_KN @ r_TS_N
    size = float(flight.navigation.target_size) / np.linalg.norm(r_TS_N)
    return BoxMeasurement(
        tangent=jnp.asarray(r_K[:2] / r_K[2]),
        log_size=jnp.float64(np.log(size)),
        side_px=jnp.float64(size * float(flight.vehicle.focal_px)),
        present=jnp.asarray(present),
        truncated=jnp.asarray(truncated),
        half_frame_tangent=jnp.full(2, np.tan(np.deg2rad(5.0))),
        attitude_variance_change=jnp.zeros(()),
    )
