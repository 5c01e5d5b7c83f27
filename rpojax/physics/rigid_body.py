"""Rotational dynamics of rigid bodies, with and without reaction wheels."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree
from rpojax.core.vectors import apply, apply_transposed, cross
from rpojax.value_types import Inertia

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]


@pytree
class Body:
    """Mass properties and size."""

    mass: Array = number("mass at the start", unit="kg", above=0.0)
    inertia: Array = number("inertia about the centre of mass, wheels locked, B", unit="kg_m2", form=Inertia)
    radius: Array = number(
        "radius of a sphere about the centre of mass that holds the body. Used for the distance of the hulls",
        unit="m",
        at_least=0.0,
        default=0.4,
    )


def inverse_3x3(matrix: Matrix) -> Matrix:
    """Inverse of a 3x3 matrix by cofactors (batched LAPACK is slow on matrices this small)."""
    a, b, c = matrix[0], matrix[1], matrix[2]
    cofactors = jnp.stack([cross(b, c), cross(c, a), cross(a, b)], axis=1)
    return cofactors / jnp.sum(a * cofactors[:, 0], axis=0)


def angular_acceleration(inertia: Matrix, inverse_inertia: Matrix, omega_B: Vector, torque_B: Vector) -> Vector:
    """Angular acceleration `omega_dot` [rad/s^2] of a rigid body by Euler's equation, body axes."""
    return apply(inverse_inertia, torque_B - cross(omega_B, apply(inertia, omega_B)))


def inverse_hub_inertia(inertia: Matrix, wheel_axes: Matrix, wheel_inertia: Vector) -> Matrix:
    """Inverse [1/(kg m^2)] of the body's inertia without the wheels' inertia about their spin axes."""
    return inverse_3x3(
        inertia - jnp.sum(wheel_inertia[:, None, None] * wheel_axes[:, :, None] * wheel_axes[:, None, :], 0)
    )


def wheel_momentum(wheel_axes: Matrix, wheel_inertia: Vector, wheel_speed: Vector) -> Vector:
    """Angular momentum [N m s] of the wheels relative to the body, in B."""
    return apply_transposed(wheel_axes, wheel_inertia * wheel_speed)


def accelerations_with_wheels(
    inertia: Matrix,
    inverse_hub: Matrix,
    wheel_axes: Matrix,
    wheel_inertia: Vector,
    omega_B: Vector,
    wheel_speed: Vector,
    motor_torque: Vector,
    torque_B: Vector,
) -> tuple[Vector, Vector]:
    """Angular accelerations [rad/s^2] of a body with balanced wheels and of the wheels relative to it.

    `motor_torque` (3,) [N m] acts on the wheels, its reaction on the body; `wheel_speed` [rad/s] is relative to the
    body; `inverse_hub` comes from `inverse_hub_inertia`. Schaub and Junkins, section 4.5, with momentum exchange.
    """
    momentum = apply(inertia, omega_B) + wheel_momentum(wheel_axes, wheel_inertia, wheel_speed)
    reaction = apply_transposed(wheel_axes, motor_torque)
    omega_dot = apply(inverse_hub, torque_B - cross(omega_B, momentum) - reaction)
    return omega_dot, motor_torque / wheel_inertia - apply(wheel_axes, omega_dot)
