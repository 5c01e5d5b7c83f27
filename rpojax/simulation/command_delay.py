"""Delay of commands from the flight computer until wheels and valves have them, a whole number of plant steps."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree


@pytree
class CommandsUnderWay:
    """Commands that actuators have not got yet, of the last plant steps, the oldest first.

    Attributes:
        torque: (steps, 3) of the wheels [N m]
        on_time: (steps, n) of the thrusters of the reaction control system [s], None without them
    """

    torque: Array
    on_time: Array | None


def none_under_way(steps: int, thrusters: int, zero: Float[Array, ""]) -> CommandsUnderWay:
    """Commands for nothing; `zero` has their type."""
    return CommandsUnderWay(
        torque=jnp.broadcast_to(zero, (steps, 3)),
        on_time=jnp.broadcast_to(zero, (steps, thrusters)) if thrusters else None,
    )


def exchanged(waiting: Float[Array, "steps k"], command: Float[Array, " k"]) -> tuple[Array, Array]:
    """The oldest command (k,), and what waits after a new one."""
    return waiting[0], jnp.concatenate([waiting[1:], command[None, :]])
