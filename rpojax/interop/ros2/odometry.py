"""Values of `nav_msgs/Odometry`: pose and twist of a child frame in its parent, with covariances.

The pose and its covariance are in the parent's axes, the twist and its covariance in the child's.

ROS orientations from attitude quaternions, and back.

A ROS `orientation` is the attitude of the child frame in its parent: it turns child components into parent components,
so it is the conjugate of the scalar-first `q_BN`, in the order x, y, z, w.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.pytree import pytree
from rpojax.core.vectors import apply
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate

Quaternion = Float[Array, "4"]
Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]


def orientation_from_quaternion(q_BA: Quaternion) -> Quaternion:
    """ROS orientation (x, y, z, w) of B in A, from the scalar-first `q_BA` that turns A into B components."""
    return jnp.concatenate([-q_BA[1:], q_BA[:1]])


def quaternion_from_orientation(xyzw: Quaternion) -> Quaternion:
    """Scalar-first `q_BA` of a ROS orientation (x, y, z, w) of B in A, inverse of `orientation_from_quaternion`."""
    return jnp.concatenate([xyzw[3:], -xyzw[:3]])


@pytree
class Odometry:
    """Pose and twist of a child frame in its parent.

    Attributes:
        position: (3,) [m] in the parent
        orientation: (4,) x, y, z, w of the child in the parent
        velocity: (3,) [m/s] derivative of the position in the parent, along the child's axes
        rate: (3,) [rad/s] relative to the parent, along the child's axes
        pose_covariance: (6, 6) of position and small rotation, in the parent's axes
        twist_covariance: (6, 6) of velocity and rate, in the child's axes
    """

    position: Array
    orientation: Array
    velocity: Array
    rate: Array
    pose_covariance: Array
    twist_covariance: Array


def rotate_covariance(R: Matrix, P: Matrix) -> Matrix:
    """Covariance `P` in the axes into which `R` turns components: `R P R'`."""
    return R @ P @ R.T


def block_diagonal(first: Matrix, second: Matrix) -> Float[Array, "6 6"]:
    """Covariance (6, 6) of two uncorrelated 3-vectors."""
    zero = jnp.zeros((3, 3), dtype=first.dtype)
    return jnp.concatenate(
        [jnp.concatenate([first, zero], axis=1), jnp.concatenate([zero, second], axis=1)],
        axis=0,
    )


def relative_quaternion(q_CA: Quaternion, q_BA: Quaternion) -> Quaternion:
    """`q_CB`."""
    return quaternion.multiply(q_CA, quaternion.conjugate(q_BA))


def true_odometry(position: Vector, q: Quaternion, velocity: Vector, rate: Vector) -> Odometry:
    """Odometry with zero covariance; `velocity` [m/s] is along the parent's axes, `rate` [rad/s] along the child's."""
    zero = jnp.zeros((6, 6), dtype=position.dtype)
    return Odometry(
        position=position,
        orientation=orientation_from_quaternion(q),
        velocity=quaternion.rotate(q, velocity),
        rate=rate,
        pose_covariance=zero,
        twist_covariance=zero,
    )


def estimated_odometry(
    position: Vector,
    q_BA: Quaternion,
    velocity: Vector,
    rate: Vector,
    orbit_covariance: Float[Array, "6 6"],
    attitude_covariance: Matrix,
    rate_covariance: Matrix,
) -> Odometry:
    """Odometry of a body B in A from estimates.

    Position [m], velocity [m/s] and their covariance are in A, rate [rad/s] and the covariances of attitude [rad^2] and
    rate in B. The message has no place for the correlation of position and velocity. The velocity is along the axes of
    the estimated body: turned back with the same orientation it is the one in A, with its covariance, so the attitude
    error is not part of it.
    """
    R = quaternion.to_matrix(q_BA)
    return Odometry(
        position=position,
        orientation=orientation_from_quaternion(q_BA),
        velocity=apply(R, velocity),
        rate=rate,
        pose_covariance=block_diagonal(orbit_covariance[:3, :3], rotate_covariance(R.T, attitude_covariance)),
        twist_covariance=block_diagonal(rotate_covariance(R, orbit_covariance[3:, 3:]), rate_covariance),
    )


def rate_covariance(attitude: AttitudeEstimate, gyro_variance: Array) -> Matrix:
    """Covariance [rad^2/s^2] of the estimated rate: a gyro sample minus its estimated bias."""
    P = attitude.covariance
    return P[3:, 3:] + gyro_variance * jnp.eye(3, dtype=P.dtype)


def servicer_estimate(orbit: OrbitEstimate, attitude: AttitudeEstimate, gyro_variance: Array) -> Odometry:
    """Estimated odometry of the servicer body in N."""
    servicer = orbit.servicer
    return estimated_odometry(
        servicer.r_SN_N,
        attitude.q_BN,
        servicer.v_SN_N,
        attitude.omega_BN_B,
        servicer.motion_covariance,
        attitude.covariance[:3, :3],
        rate_covariance(attitude, gyro_variance),
    )


def relative_estimate(orbit: OrbitEstimate, attitude: AttitudeEstimate, gyro_variance: Array) -> Odometry:
    """Estimated odometry of the servicer body in the Hill frame of the estimated target orbit.

    The error of that frame is left out: 1 m across the target's orbit turns it by 1e-7 rad, which moves the servicer by
    some micrometres.
    """
    r_ST_N, v_ST_N = -orbit.relative.r_TS_N, -orbit.relative.v_TS_N
    R_HN, omega_HN_N = hill_frame(orbit.servicer.r_SN_N - r_ST_N, orbit.servicer.v_SN_N - v_ST_N)
    rho, rho_dot = inertial_to_hill(r_ST_N, v_ST_N, R_HN, omega_HN_N)
    return estimated_odometry(
        rho,
        relative_quaternion(attitude.q_BN, quaternion.from_matrix(R_HN)),
        rho_dot,
        attitude.omega_BN_B - quaternion.rotate(attitude.q_BN, omega_HN_N),
        hill_covariance(R_HN, omega_HN_N, orbit.relative.motion_covariance),
        attitude.covariance[:3, :3],
        rate_covariance(attitude, gyro_variance),
    )


def hill_covariance(R_HN: Matrix, omega_HN_N: Vector, P_N: Float[Array, "6 6"]) -> Float[Array, "6 6"]:
    """Covariance of (rho, rho_dot) from that of relative position and inertial velocity in N."""

    def to_hill(state: Float[Array, "6"]) -> Float[Array, "6"]:
        return jnp.concatenate(inertial_to_hill(state[:3], state[3:], R_HN, omega_HN_N))

    jacobian = jax.jacfwd(to_hill)(jnp.zeros(6, dtype=P_N.dtype))
    return jacobian @ P_N @ jacobian.T


def target_frame_estimate(orbit: OrbitEstimate) -> Odometry:
    """Estimated odometry of the target's Hill frame in N, its covariance propagated from that of the target's orbit."""
    P = orbit.servicer.motion_covariance + orbit.relative.motion_covariance
    r_TN_N = orbit.servicer.r_SN_N + orbit.relative.r_TS_N
    v_TN_N = orbit.servicer.v_SN_N + orbit.relative.v_TS_N
    R_HN, omega_HN_N = hill_frame(r_TN_N, v_TN_N)

    def rotation_and_rate(state: Float[Array, "6"]) -> tuple[Vector, Vector]:
        R, omega = hill_frame(state[:3], state[3:])
        S = R_HN.T @ R
        # A small rotation phi of the axes has the matrix 1 - [phi x] in these axes.
        return jnp.stack([S[1, 2], S[2, 0], S[0, 1]]), apply(R, omega)

    rotation_jacobian, rate_jacobian = jax.jacfwd(rotation_and_rate)(jnp.concatenate([r_TN_N, v_TN_N]))
    pose_jacobian = jnp.concatenate([jnp.eye(3, 6, dtype=P.dtype), rotation_jacobian], axis=0)
    twist_jacobian = jnp.concatenate(
        [jnp.concatenate([jnp.zeros((3, 3), dtype=P.dtype), R_HN], axis=1), rate_jacobian], axis=0
    )
    return Odometry(
        position=r_TN_N,
        orientation=orientation_from_quaternion(quaternion.from_matrix(R_HN)),
        velocity=apply(R_HN, v_TN_N),
        rate=apply(R_HN, omega_HN_N),
        pose_covariance=pose_jacobian @ P @ pose_jacobian.T,
        twist_covariance=twist_jacobian @ P @ twist_jacobian.T,
    )
