"""Orbit estimates that come as messages, in the flight software's own terms: the inverse of `tick_values`."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.frames import hill_frame, hill_to_inertial
from rpojax.core.quaternion import conjugate, rotate, to_matrix
from rpojax.interop.ros2.frame_names import block_diagonal, quaternion_from_orientation, rotate_covariance
from rpojax.simulation.external_stages import ExternalOrbitEstimate

_FRAME_ITERATIONS = 3
"""The Hill frame is that of the target, which the servicer's orbit is a first guess of, wrong by 1e-5."""

Vector = Float[Array, "3"]
Quaternion = Float[Array, "4"]
Matrix = Float[Array, "3 3"]
OdometryArrays = tuple[Vector, Quaternion, Vector, Matrix, Matrix]
"""Position, orientation (x, y, z, w), velocity along the child's axes, covariance of position and of that velocity."""


def orbit_estimate_from_odometry(servicer: Any, relative: Any) -> ExternalOrbitEstimate:
    """Estimate from the servicer's `nav_msgs/Odometry` in `eci` and the one in `hill`."""
    return _orbit_estimate(_odometry_arrays(servicer), _odometry_arrays(relative))


def _odometry_arrays(message: Any) -> tuple[np.ndarray, ...]:
    pose, twist = message.pose, message.twist
    place, turn, velocity = pose.pose.position, pose.pose.orientation, twist.twist.linear
    return (
        np.array([place.x, place.y, place.z]),
        np.array([turn.x, turn.y, turn.z, turn.w]),
        np.array([velocity.x, velocity.y, velocity.z]),
        np.asarray(pose.covariance, dtype=np.float64).reshape(6, 6)[:3, :3],
        np.asarray(twist.covariance, dtype=np.float64).reshape(6, 6)[:3, :3],
    )


@jax.jit
def _orbit_estimate(servicer: OdometryArrays, relative: OdometryArrays) -> ExternalOrbitEstimate:
    r_SN_N, v_SN_N, P_servicer = _in_parent(*servicer)
    rho, rho_dot, P_H = _in_parent(*relative)
    R_HN, omega_HN_N = hill_frame(r_SN_N, v_SN_N)
    for _ in range(_FRAME_ITERATIONS):
        r_ST_N, v_ST_N = hill_to_inertial(rho, rho_dot, R_HN, omega_HN_N)
        R_HN, omega_HN_N = hill_frame(r_SN_N - r_ST_N, v_SN_N - v_ST_N)
    r_ST_N, v_ST_N = hill_to_inertial(rho, rho_dot, R_HN, omega_HN_N)

    def back(state: Float[Array, "6"]) -> Float[Array, "6"]:
        return jnp.concatenate(hill_to_inertial(state[:3], state[3:], R_HN, omega_HN_N))

    J = jax.jacfwd(back)(jnp.concatenate([rho, rho_dot]))
    return ExternalOrbitEstimate(
        r_SN_N=r_SN_N,
        v_SN_N=v_SN_N,
        r_TS_N=-r_ST_N,
        v_TS_N=-v_ST_N,
        servicer_covariance=P_servicer,
        relative_covariance=J @ P_H @ J.T,
    )


def _in_parent(
    position: Vector, xyzw: Quaternion, velocity: Vector, P_position: Matrix, P_velocity: Matrix
) -> tuple[Vector, Vector, Float[Array, "6 6"]]:
    """Position, velocity and their covariance in the parent's axes; what they have in common is not known."""
    q_BA = quaternion_from_orientation(xyzw)
    P = block_diagonal(P_position, rotate_covariance(to_matrix(q_BA).T, P_velocity))
    return position, rotate(conjugate(q_BA), velocity), P
