"""Fixed position in the Hill frame, held by burns where the free motion does not stay."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree
from rpojax.flight.guidance.references.phase_entry import PhaseEntry

Scalar = Float[Array, ""]


@pytree
class Hold:
    """Fixed position."""

    position: Array = number("position of the servicer from the target, H", unit="m", length=3)


def state(reference: Hold, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Scalar) -> Float[Array, "6"]:
    """Desired relative state in H [m, m/s], at all times the same."""
    del entry, orbit, elapsed
    return jnp.concatenate([reference.position, jnp.zeros_like(reference.position)])


def end_position(reference: Hold, entry: PhaseEntry) -> Float[Array, "3"]:
    """Position in H at which the servicer arrives [m]."""
    del entry
    return reference.position
