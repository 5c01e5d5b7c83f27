"""Reaction wheels with torque and speed limits, bearing friction and quantised drive torque."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class ReactionWheels:
    """Three reaction wheels.

    Attributes:
        axes: (3, 3) spin axes in B, one a row
        inertia: (3,) about the spin axis [kg m^2]
        torque_limit: (3,) [N m]
        speed_limit: (3,) relative to the body [rad/s]
        initial_speed: (3,) [rad/s]
        viscous_friction: (3,) torque per speed [N m s/rad]
        coulomb_friction: (3,) torque of a turning wheel [N m]
        stiction_speed: () below about this speed the Coulomb torque fades to zero [rad/s]
        torque_step: () quantum of the drive torque [N m]
    """

    axes: Array
    inertia: Array
    torque_limit: Array
    speed_limit: Array
    initial_speed: Array
    viscous_friction: Array
    coulomb_friction: Array
    stiction_speed: Array
    torque_step: Array


def quantise_torque(wheels: ReactionWheels, command: Vector) -> Vector:
    """Torque command [N m] rounded to the drive's steps, with the derivative of the command itself."""
    rounded = wheels.torque_step * jnp.round(command / wheels.torque_step)
    return command + jax.lax.stop_gradient(rounded - command)


def bearing_friction(wheels: ReactionWheels, speed: Vector) -> Vector:
    """Torque of viscous and Coulomb friction on each wheel [N m] at its speed relative to the body [rad/s].

    The Coulomb part follows the hyperbolic tangent of the speed, so that it has a derivative when the wheel reverses.
    """
    return -wheels.viscous_friction * speed - wheels.coulomb_friction * jnp.tanh(speed / wheels.stiction_speed)


def limit_torque(wheels: ReactionWheels, command: Vector, speed: Vector, dt: float | Scalar) -> Vector:
    """Torque command [N m] for the next `dt` [s] within the torque and speed limits."""
    torque = jnp.clip(command, -wheels.torque_limit, wheels.torque_limit)
    up = wheels.inertia * (wheels.speed_limit - speed) / dt
    down = wheels.inertia * (-wheels.speed_limit - speed) / dt
    return jnp.clip(torque, jnp.minimum(down, 0.0), jnp.maximum(up, 0.0))
