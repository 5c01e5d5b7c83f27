"""State in which a reference trajectory begins, and how a reference joins the motion before it."""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, advanced, constants_of_motion, free_motion
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
State = Float[Array, "6"]


@pytree
class PhaseEntry:
    """Servicer and target when a reference begins.

    What a reference takes from them stays as it was known then: the osculating orbit changes with each measurement and,
    by the Earth's oblateness, on the way.

    Attributes:
        relative_state: (6,) rho and rho_dot in H [m, m/s]
        orbit: of the target
    """

    relative_state: Array
    orbit: TargetOrbit


def motion_without_burns(entry: PhaseEntry, elapsed: Scalar) -> State:
    """Relative state [m, m/s] of the free motion through the entry, `elapsed` [s] after or, if negative, before it."""
    constants = constants_of_motion(entry.orbit, entry.relative_state)
    return free_motion(advanced(entry.orbit, elapsed), elapsed, constants)


def from_entry(entry: PhaseEntry, elapsed: Scalar, state: State) -> State:
    """A reference [m, m/s] that starts at the entry's position, continued before it by the motion that led there."""
    return jnp.where(elapsed < 0.0, motion_without_burns(entry, elapsed), state)


def smooth_step(elapsed: Scalar, duration: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Quintic from 0 to 1 in a duration [s], 1 at once if that is 0; its first [1/s] and second [1/s^2] derivative."""
    lasts = duration > 0.0
    length = jnp.where(lasts, duration, 1.0)
    place = jnp.where(lasts, jnp.clip(elapsed / length, 0.0, 1.0), 1.0)
    rest = 1.0 - place
    share = place**3 * (10.0 - 15.0 * place + 6.0 * place * place)
    slope = 30.0 * (place * rest) ** 2 / length
    return share, slope, 60.0 * place * rest * (rest - place) / length**2


def slowing_down(velocity: Vector, elapsed: Scalar, duration: Scalar, longest: Scalar) -> State:
    """Way and velocity [m, m/s] of a motion that begins with a velocity [m/s], turns back and ends where it began.

    It takes a `duration` [s], 0 for no motion at all, or as much less as lets it lead no farther than `longest` [m].
    """
    lasts = duration > 0.0
    length = jnp.where(lasts, duration, 1.0)
    length = length / jnp.maximum(1.0, _FARTHEST * gradient_safe.norm(velocity) * length / longest)
    place = jnp.where(lasts, jnp.clip(elapsed / length, 0.0, 1.0), 1.0)
    rest = 1.0 - place
    return jnp.concatenate([place * rest * rest * length * velocity, rest * (1.0 - 3.0 * place) * velocity])


_FARTHEST: Final = 4.0 / 27.0
"""Greatest value of x (1 - x)^2 between 0 and 1, at 1/3 [-]."""
