"""Orbit estimates that come as messages, in the flight software's own terms: the inverse of `tick_values`."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.frames import hill_frame, hill_to_inertial
from rpojax.core.quaternion import conjugate, rotate, to_matrix
from rpojax.interop.ros2.frame_names import blocks, from_orientation, turned
from rpojax.simulation.external_stages import GivenOrbit

_ROUNDS = 3
"""The Hill frame is that of the target, which the servicer's orbit is a first guess of, wrong by 1e-5."""

Vector = Float[Array, "3"]
Quaternion = Float[Array, "4"]
Matrix = Float[Array, "3 3"]
Seen = tuple[Vector, Quaternion, Vector, Matrix, Matrix]
"""Position, orientation (x, y, z, w), velocity along the child's axes, covariance of position and of that velocity."""


def given_orbit(servicer: Any, relative: Any) -> GivenOrbit:
    """Estimate from the servicer's `nav_msgs/Odometry` in `eci` and the one in `hill`."""
    return _given_orbit(_seen(servicer), _seen(relative))


def _seen(message: Any) -> tuple[np.ndarray, ...]:
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
def _given_orbit(servicer: Seen, relative: Seen) -> GivenOrbit:
    r_SN_N, v_SN_N, P_servicer = _in_parent(*servicer)
    rho, rho_dot, P_H = _in_parent(*relative)
    R_HN, omega_HN_N = hill_frame(r_SN_N, v_SN_N)
    for _ in range(_ROUNDS):
        r_ST_N, v_ST_N = hill_to_inertial(rho, rho_dot, R_HN, omega_HN_N)
        R_HN, omega_HN_N = hill_frame(r_SN_N - r_ST_N, v_SN_N - v_ST_N)
    r_ST_N, v_ST_N = hill_to_inertial(rho, rho_dot, R_HN, omega_HN_N)

    def back(state: Float[Array, "6"]) -> Float[Array, "6"]:
        return jnp.concatenate(hill_to_inertial(state[:3], state[3:], R_HN, omega_HN_N))

    J = jax.jacfwd(back)(jnp.concatenate([rho, rho_dot]))
    return GivenOrbit(
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
    q_BA = from_orientation(xyzw)
    P = blocks(P_position, turned(to_matrix(q_BA).T, P_velocity))
    return position, rotate(conjugate(q_BA), velocity), P
