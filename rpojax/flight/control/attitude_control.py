"""Attitude control: quaternion-error feedback with rate damping and feed-forward."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import rotate
from rpojax.core.vectors import apply, apply_transposed, cross
from rpojax.flight.control import wheel_torque_allocation
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.vehicle_model import VehicleModel

Vector = Float[Array, "3"]


@pytree
class AttitudeControlTuning:
    """Gains of the attitude controller."""

    bandwidth: Array = number("natural frequency of the closed loop", unit="rad_s", above=0.0)
    damping: Array = number("damping ratio", above=0.0)


@pytree
class AttitudeCommand:
    """Commanded attitude motion at one time.

    Attributes:
        q_CN: (4,) commanded attitude
        omega_CN_C: (3,) commanded rate [rad/s]
        acceleration_C: (3,) commanded angular acceleration [rad/s^2]
    """

    q_CN: Array
    omega_CN_C: Array
    acceleration_C: Array


def wheel_torque(
    control: AttitudeControlTuning,
    vehicle: VehicleModel,
    allocation: Float[Array, "3 3"],
    estimate: AttitudeEstimate,
    command: AttitudeCommand,
    wheel_speed: Vector,
) -> Vector:
    """Motor torque command of each wheel [N m], scaled to the torque limit without a change of direction.

    `allocation` (3, 3) comes from `wheel_torque_allocation.allocation_matrix`; `wheel_speed` [rad/s] from the
    tachometers.
    """
    torque_B = body_torque(control, vehicle, estimate, command, wheel_speed)
    return wheel_torque_allocation.allocate(allocation, torque_B, vehicle.wheel_torque_limit)


def body_torque(
    control: AttitudeControlTuning,
    vehicle: VehicleModel,
    estimate: AttitudeEstimate,
    command: AttitudeCommand,
    wheel_speed: Vector,
) -> Vector:
    """Torque on the body [N m] by feedback, feed-forward of the acceleration and gyroscopic compensation."""
    q_BC = quaternion.multiply(estimate.q_BN, quaternion.conjugate(command.q_CN))
    # Twice the vector part: the rotation vector for small errors, and bounded for large ones.
    attitude_error = -2.0 * jnp.where(q_BC[0] < 0.0, -q_BC[1:], q_BC[1:])
    omega = estimate.omega_BN_B
    rate_error = omega - rotate(q_BC, command.omega_CN_C)
    acceleration = (
        rotate(q_BC, command.acceleration_C)
        - control.bandwidth**2 * attitude_error
        - 2.0 * control.damping * control.bandwidth * rate_error
    )
    momentum = apply(vehicle.inertia, omega) + apply_transposed(vehicle.wheel_axes, vehicle.wheel_inertia * wheel_speed)
    return apply(vehicle.inertia, acceleration) + cross(omega, momentum)
