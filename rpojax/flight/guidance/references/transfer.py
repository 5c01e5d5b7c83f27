"""Transfer to a position in a given time: by two impulses, or by more of them along a glide slope.

Glide slope: impulses at equal intervals put the servicer on points of the straight line to the end, with a speed that
falls exponentially (Hablani, Tapper and Dana-Bashian, "Guidance and relative navigation for autonomous rendezvous in a
circular orbit", 2002). Between the impulses the motion is free. Where the time between two impulses is near one that
admits no free motion, such as half an orbit across the track or a whole one, there is another impulse on the way.
"""

from typing import Annotated

import jax.numpy as jnp
from jaxtyping import Array, Float
from pydantic import Field

from rpojax.core.declared_numbers import number
from rpojax.core.orbits.two_impulse_transfer import TransferArc, state_on_arc, transfer_arc
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, advanced
from rpojax.core.pytree import pytree
from rpojax.flight.guidance.references.phase_entry import PhaseEntry, from_entry

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


_Pulses = Annotated[int, Field(ge=2, le=64)]


@pytree
class Transfer:
    """Transfer from the position at the entry."""

    position: Array = number("where it ends, from the target, H", unit="m", length=3)
    duration: Array = number("duration of the transfer", unit="s", above=0.0)
    pulses: Array = number("number of impulses, those at departure and arrival included", form=_Pulses, default=2)
    speed_ratio: Array = number(
        "speed along the glide slope at its end over that at its beginning", above=0.0, at_most=1.0, default=1.0
    )


def state(reference: Transfer, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Scalar) -> Float[Array, "6"]:
    """Desired relative state in H [m, m/s] `elapsed` [s] after the entry, on the target's orbit as it was known then.

    After its duration it stays at the end.
    """
    del orbit
    arcs = reference.pulses - 1.0
    interval = reference.duration / arcs
    arc = jnp.clip(jnp.floor(elapsed / interval), 0.0, arcs - 1.0)
    way, departure, before = arc_between_impulses(reference, entry, arc)
    moving = state_on_arc(way, departure, elapsed - arc * interval)
    arrived = jnp.concatenate([reference.position, jnp.zeros_like(before[3:])])
    return from_entry(entry, elapsed, jnp.where(elapsed < reference.duration, moving, arrived))


def arc_between_impulses(
    reference: Transfer, entry: PhaseEntry, arc: Scalar
) -> tuple[TransferArc, TargetOrbit, Float[Array, "6"]]:
    """Way from an impulse to the next, counted from 0, the target's place at its departure, and the state before it.

    The state is in H [m, m/s].
    """
    arcs = reference.pulses - 1.0
    interval = reference.duration / arcs
    departure = advanced(entry.orbit, arc * interval)
    start = _waypoint(reference, entry, arc / arcs)
    end = _waypoint(reference, entry, (arc + 1.0) / arcs)
    # The servicer comes to the first impulse by itself, to the others about straight along the glide slope.
    velocity = jnp.where(arc > 0.0, (end - start) / interval, entry.relative_state[3:])
    before = jnp.concatenate([start, velocity])
    return transfer_arc(departure, before, end, interval), departure, before


def end_position(reference: Transfer, entry: PhaseEntry) -> Vector:
    """Position in H at which the servicer arrives [m]."""
    del entry
    return reference.position


def _waypoint(reference: Transfer, entry: PhaseEntry, share: Scalar) -> Vector:
    """Point of the glide slope [m] after a share of the duration."""
    rate = jnp.log(reference.speed_ratio)
    small = jnp.abs(rate) < _SMALL_RATE
    safe = jnp.where(small, 1.0, rate)
    # Linear in the small rate, so that a constant speed has the derivative of its neighbours.
    nearly_even = share + 0.5 * rate * share * (share - 1.0)
    covered = jnp.where(small, nearly_even, jnp.expm1(safe * share) / jnp.expm1(safe))
    start = entry.relative_state[:3]
    return start + covered * (reference.position - start)


_SMALL_RATE = 1e-6
"""Logarithm of the ratio of speeds below which the way is linear in it [-]: its square is left out, 1e-12."""
