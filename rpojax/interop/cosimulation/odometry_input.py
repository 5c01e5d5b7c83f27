"""Orbit estimates of the flight software from received odometry messages."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.frames import hill_frame, hill_to_inertial
from rpojax.core.quaternion import conjugate, rotate, to_matrix
from rpojax.interop.ros2.odometry import block_diagonal, rotate_covariance
from rpojax.interop.ros2.ros_orientation import quaternion_from_orientation
from rpojax.simulation.external_inputs import ExternalOrbitEstimate

_FRAME_ITERATIONS = 3
"""Fixed-point iterations for the target's Hill frame, started at the servicer's, which is off by 1e-5 rad."""

Vector = Float[Array, "3"]
Quaternion = Float[Array, "4"]
Matrix = Float[Array, "3 3"]
OdometryArrays = tuple[Vector, Quaternion, Vector, Matrix, Matrix]
"""Position, orientation (x, y, z, w), velocity along the child's axes, covariance of position and of that velocity."""


def orbit_estimate_from_odometry(servicer: Any, relative: Any) -> ExternalOrbitEstimate:
    """Orbit estimate from the servicer's `nav_msgs/Odometry` in `eci` and the one in `hill`."""
    return _orbit_estimate(_odometry_arrays(servicer), _odometry_arrays(relative))


def _odometry_arrays(message: Any) -> tuple[np.ndarray, ...]:
    pose, twist = message.pose, message.twist
    position, orientation, velocity = pose.pose.position, pose.pose.orientation, twist.twist.linear
    return (
        np.array([position.x, position.y, position.z]),
        np.array([orientation.x, orientation.y, orientation.z, orientation.w]),
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

    def to_inertial(state: Float[Array, "6"]) -> Float[Array, "6"]:
        return jnp.concatenate(hill_to_inertial(state[:3], state[3:], R_HN, omega_HN_N))

    jacobian = jax.jacfwd(to_inertial)(jnp.concatenate([rho, rho_dot]))
    return ExternalOrbitEstimate(
        r_SN_N=r_SN_N,
        v_SN_N=v_SN_N,
        r_TS_N=-r_ST_N,
        v_TS_N=-v_ST_N,
        servicer_covariance=P_servicer,
        relative_covariance=jacobian @ P_H @ jacobian.T,
    )


def _in_parent(
    position: Vector, xyzw: Quaternion, velocity: Vector, P_position: Matrix, P_velocity: Matrix
) -> tuple[Vector, Vector, Float[Array, "6 6"]]:
    """Position, velocity and their covariance in the parent's axes, without correlation between the two."""
    q_BA = quaternion_from_orientation(xyzw)
    P = block_diagonal(P_position, rotate_covariance(to_matrix(q_BA).T, P_velocity))
    return position, rotate(conjugate(q_BA), velocity), P
