"""Attitude that points the camera at the estimated target."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.frames import look_at
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree, replace
from rpojax.core.quaternion import rotate
from rpojax.core.vectors import cross
from rpojax.flight.guidance.other_pointing import OtherPointing
from rpojax.flight.guidance.target_visibility import is_in_sight
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import VehicleModel

Vector = Float[Array, "3"]


def look_attitude(
    vehicle: VehicleModel, estimate: OrbitEstimate, q_before: Float[Array, "4"] | None = None
) -> tuple[Float[Array, "4"], Vector]:
    """Attitude `q_BN` with the camera on the estimated target, and its rate [rad/s] in B.

    The camera's x axis is as near as possible to the orbit normal. Near the normal itself that direction turns with
    every error of the estimate; there the camera turns by the smallest angle from the attitude `q_before`, if given.
    """
    line_of_sight = gradient_safe.normalize(estimate.relative.r_TS_N)
    distance = gradient_safe.norm(estimate.relative.r_TS_N)
    v_TS_N = estimate.relative.v_TS_N
    line_of_sight_rate = (v_TS_N - jnp.sum(v_TS_N * line_of_sight, axis=0) * line_of_sight) / distance
    normal = gradient_safe.normalize(cross(estimate.servicer.r_SN_N, estimate.servicer.v_SN_N))
    elevation = jnp.sum(normal * line_of_sight, axis=0)
    is_near_normal = jnp.abs(elevation) > _NEAR_NORMAL
    # Exactly along the normal any roll will do.
    right = jnp.where(jnp.abs(elevation) > _ALONG_NORMAL, gradient_safe.normalize(estimate.servicer.v_SN_N), normal)
    R_KN = look_at(line_of_sight, right)
    arm = gradient_safe.norm(normal - elevation * line_of_sight)
    roll_arm_rate = -elevation * jnp.sum(line_of_sight_rate * R_KN[1], axis=0)
    roll_rate = jnp.where(is_near_normal, 0.0, roll_arm_rate / jnp.where(is_near_normal, 1.0, arm))
    omega_N = cross(line_of_sight, line_of_sight_rate) + roll_rate * line_of_sight
    q_KB = quaternion.normalize(vehicle.camera_mounting)
    q_BN = quaternion.multiply(quaternion.conjugate(q_KB), quaternion.from_matrix(R_KN))
    if q_before is not None:
        q_BN = jnp.where(is_near_normal, _nearest_look_attitude(q_KB, line_of_sight, q_before), q_BN)
    return q_BN, rotate(q_BN, omega_N)


_NEAR_NORMAL = math.cos(math.radians(10.0))
"""Cosine of the angle from the orbit normal within which it does not tell the camera's x axis: there an error of the
bearing is six times (1 / sin 10 deg) as large in the roll."""


_ALONG_NORMAL = 1.0 - 1e-12
"""Cosine of that angle within which the direction of the x axis is lost in rounding: 1.4e-6 rad."""


def _nearest_look_attitude(
    q_KB: Float[Array, "4"], line_of_sight: Vector, q_before: Float[Array, "4"]
) -> Float[Array, "4"]:
    """Attitude `q_BN` with the camera along the line of sight, by the smallest rotation from `q_before`."""
    boresight_B = rotate(quaternion.conjugate(q_KB), jnp.array([0.0, 0.0, 1.0], dtype=q_KB.dtype))
    boresight_N = rotate(quaternion.conjugate(q_before), boresight_B)
    turn = quaternion.rotation_vector_between(boresight_N, line_of_sight)
    # The attitude is carried from tick to tick, and with it the rounding of its length.
    return quaternion.normalize(quaternion.multiply(q_before, quaternion.exp(-turn)))


@pytree
class TargetPointing:
    """Attitude that points the camera at the estimated target, and whether the target should be in sight then.

    Attributes:
        q_BN: (4,) look attitude
        visible: () bool
        sun_N: (3,) position of the Sun [m]
    """

    q_BN: Array
    visible: Array
    sun_N: Array


def point_at_target(
    vehicle: VehicleModel, estimate: OrbitEstimate, q_before: Float[Array, "4"], sun_N: Vector
) -> TargetPointing:
    """Target pointing after an attitude `q_before`, with the Sun at `sun_N` [m]."""
    visible = is_in_sight(vehicle, estimate, sun_N)
    return TargetPointing(q_BN=look_attitude(vehicle, estimate, q_before)[0], visible=visible, sun_N=sun_N)


def with_other(pointing: TargetPointing, other: OtherPointing | None) -> TargetPointing:
    """Pointing in a phase that may ask for an attitude away from the target, which is not visible then."""
    if other is None:
        return pointing
    q_BN = jnp.where(other.is_wanted, other.q_BN, pointing.q_BN)
    return replace(pointing, q_BN=q_BN, visible=pointing.visible & ~other.is_wanted)
