"""Looking at the estimated target: with which attitude, how well its place is known, and whether there is light."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.frames import apply, look_at
from rpojax.core.numerics import safe
from rpojax.core.orbits import eclipse
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import rotate
from rpojax.flight.navigation.orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import VehicleModel

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


def look_attitude(vehicle: VehicleModel, estimate: OrbitEstimate) -> tuple[Float[Array, "4"], Vector]:
    """Attitude `q_BN` with the camera on the estimated target and its x axis towards the orbit normal, and its rate."""
    line_of_sight = safe.normalize(estimate.relative.r_TS_N)
    distance = safe.norm(estimate.relative.r_TS_N)
    line_of_sight_rate = (
        estimate.relative.v_TS_N - jnp.sum(estimate.relative.v_TS_N * line_of_sight, axis=0) * line_of_sight
    ) / distance
    normal = safe.normalize(quaternion.cross(estimate.servicer.r_SN_N, estimate.servicer.v_SN_N))
    R_KN = look_at(line_of_sight, normal)
    elevation = jnp.sum(normal * line_of_sight, axis=0)
    roll_rate = (
        -elevation * jnp.sum(line_of_sight_rate * R_KN[1], axis=0) / safe.norm(normal - elevation * line_of_sight)
    )
    omega_N = quaternion.cross(line_of_sight, line_of_sight_rate) + roll_rate * line_of_sight
    q_BK = quaternion.conjugate(quaternion.normalize(vehicle.camera_mounting))
    q_BN = quaternion.multiply(q_BK, quaternion.from_matrix(R_KN))
    return q_BN, rotate(q_BN, omega_N)


def relative_range_sigma(estimate: OrbitEstimate) -> Scalar:
    """1-sigma of the range over the range [-]."""
    line_of_sight = safe.normalize(estimate.relative.r_TS_N)
    P = estimate.relative.covariance[:3, :3]
    return safe.sqrt(jnp.sum(line_of_sight * apply(P, line_of_sight), axis=0)) / safe.norm(estimate.relative.r_TS_N)


def bearing_sigma(estimate: OrbitEstimate) -> Scalar:
    """1-sigma of the bearing in its worse direction, at most [rad]: the trace across the line of sight."""
    line_of_sight = safe.normalize(estimate.relative.r_TS_N)
    P = estimate.relative.covariance[:3, :3]
    across = P[0, 0] + P[1, 1] + P[2, 2] - jnp.sum(line_of_sight * apply(P, line_of_sight), axis=0)
    return safe.sqrt(across) / safe.norm(estimate.relative.r_TS_N)


@pytree
class TargetPointing:
    """How the estimated target is to be looked at.

    Attributes:
        q_BN: (4,) look attitude
        visible: () bool, it should be visible then
    """

    q_BN: Array
    visible: Array


def point_at_target(vehicle: VehicleModel, estimate: OrbitEstimate, sun_N: Vector) -> TargetPointing:
    """How the estimated target is to be looked at, the Sun being at `sun_N` [m]."""
    return TargetPointing(q_BN=look_attitude(vehicle, estimate)[0], visible=is_visible(vehicle, estimate, sun_N))


def is_visible(vehicle: VehicleModel, estimate: OrbitEstimate, sun_N: Vector, tolerance: float = 0.0) -> Flag:
    """True while the target should be visible: by the estimate, the Sun at `sun_N` [m] and the camera's limits.

    `tolerance` [rad] widens the limits: what may just be visible is not to be disbelieved.
    """
    r_TN_N = estimate.servicer.r_SN_N + estimate.relative.r_TS_N
    # Cosines turn round beyond a half circle and at zero.
    phase = jnp.minimum(vehicle.phase_limit + tolerance, math.pi)
    exclusion = jnp.maximum(vehicle.sun_exclusion - tolerance, 0.0)
    return eclipse.is_observable(r_TN_N, -estimate.relative.r_TS_N, sun_N, phase, exclusion)


VISIBILITY_TOLERANCE = math.radians(10.0)
"""Widening of the camera's light limits within which a box is believed [rad]: what a bearing may be wrong at worst."""
