"""Reaction wheels with torque and speed limits, bearing friction and quantised drive torque."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree
from rpojax.value_types import Axes

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class ReactionWheels:
    """Three reaction wheels."""

    axes: Array = number("spin axes, one a row, B", form=Axes)
    inertia: Array = number("moment of inertia about the spin axis", unit="kg_m2", length=3, above=0.0)
    torque_limit: Array = number("largest motor torque", unit="n_m", length=3, above=0.0)
    speed_limit: Array = number("largest speed relative to the body", unit="rad_s", length=3, above=0.0)
    initial_speed: Array = number("speed at the start", unit="rad_s", length=3)
    viscous_friction: Array = number("bearing torque per speed", unit="n_m_s", length=3, at_least=0.0)
    coulomb_friction: Array = number("bearing torque of a turning wheel", unit="n_m", length=3, at_least=0.0)
    stiction_speed: Array = number("below about this speed the Coulomb torque falls to zero", unit="rad_s", above=0.0)
    torque_step: Array = number("quantisation of the motor torque", unit="n_m", above=0.0)


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
