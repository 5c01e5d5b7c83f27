"""Attitudes away from the target that a phase of a mission may ask for: safe from the Sun, or along the velocity."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.frames import hill_frame, look_at
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import rotate
from rpojax.core.vectors import cross
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import VehicleModel

Vector = Float[Array, "3"]


@pytree
class OtherPointing:
    """Attitude in place of that towards the target.

    Attributes:
        q_BN: (4,)
        omega_BN_B: (3,) its rate [rad/s]
        is_wanted: () bool, whether the present phase asks for it
    """

    q_BN: Array
    omega_BN_B: Array
    is_wanted: Array


def sun_safe_attitude(vehicle: VehicleModel, estimate: OrbitEstimate, sun_N: Vector) -> tuple[Array, Vector]:
    """Attitude `q_BN` with the camera away from the Sun at `sun_N` [m], and its rate [rad/s] in B."""
    away = -gradient_safe.normalize(sun_N - estimate.servicer.r_SN_N)
    # The Sun is never near the pole.
    pole = jnp.array([0.0, 0.0, 1.0], dtype=away.dtype)
    q_BN = quaternion.multiply(_q_BK(vehicle), quaternion.from_matrix(look_at(away, pole)))
    return q_BN, jnp.zeros_like(away)


def velocity_attitude(vehicle: VehicleModel, estimate: OrbitEstimate) -> tuple[Array, Vector]:
    """Attitude `q_BN` with the camera along the velocity and its x axis along the orbit normal, and its rate in B."""
    r_N, v_N = estimate.servicer.r_SN_N, estimate.servicer.v_SN_N
    _, omega_N = hill_frame(r_N, v_N)
    R_KN = look_at(gradient_safe.normalize(v_N), gradient_safe.normalize(cross(r_N, v_N)))
    q_BN = quaternion.multiply(_q_BK(vehicle), quaternion.from_matrix(R_KN))
    return q_BN, rotate(q_BN, omega_N)


def _q_BK(vehicle: VehicleModel) -> Float[Array, "4"]:
    return quaternion.conjugate(quaternion.normalize(vehicle.camera_mounting))
