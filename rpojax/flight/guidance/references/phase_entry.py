"""State in which a reference trajectory begins, and how a reference joins the motion before it."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, advanced, constants_of_motion, free_motion
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]
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


def joined(entry: PhaseEntry, elapsed: Scalar, duration: Scalar, state: State) -> State:
    """A reference [m, m/s] that is reached from the free motion of the entry in a `duration` [s], 0 for at once.

    The share of the reference grows as a cubic with horizontal ends, so that the velocity is continuous.
    """
    lasts = duration > 0.0
    length = jnp.where(lasts, duration, 1.0)
    place = jnp.where(lasts, jnp.clip(elapsed / length, 0.0, 1.0), 1.0)
    share, slope = place * place * (3.0 - 2.0 * place), 6.0 * place * (1.0 - place) / length
    free = motion_without_burns(entry, elapsed)
    change = state - free
    return free + share * change + jnp.concatenate([jnp.zeros_like(change[:3]), slope * change[:3]])
