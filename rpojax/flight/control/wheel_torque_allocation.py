"""Allocation of a body torque to three reaction wheels."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.vectors import apply

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]


def allocation_matrix(wheel_axes: Matrix) -> Matrix:
    """Matrix from body torque to wheel torques: inverse of the matrix whose columns are the wheel axes."""
    return jnp.linalg.inv(wheel_axes.T)


def allocate(allocation: Matrix, torque_B: Vector, torque_limit: Vector) -> Vector:
    """Motor torque of each wheel [N m] for a torque on the body [N m].

    A command beyond a wheel's limit [N m] is scaled down with its direction kept.
    """
    motor_torque = -apply(allocation, torque_B)
    excess = jnp.max(jnp.abs(motor_torque) / torque_limit, axis=0)
    return motor_torque / jnp.maximum(excess, 1.0)
