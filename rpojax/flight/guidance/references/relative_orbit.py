"""Free relative orbit: safety ellipse, walking ellipse or co-elliptic drift.

Separation of relative eccentricity and inclination vectors (D'Amico and Montenbruck, "Proximity operations of
formation-flying spacecraft using an eccentricity/inclination vector separation", 2006), on elliptic orbits with the
closed relative orbits of Yamanaka and Ankersen. Their radial oscillation is a sinusoid of the argument of latitude at
any eccentricity; where its phase is that of the cross-track oscillation, the servicer is out of the target's plane
whenever it passes the target's height. No burn is needed, but for perturbations.
"""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, free_motion
from rpojax.core.pytree import pytree
from rpojax.flight.guidance.references.phase_entry import PhaseEntry, joined

Scalar = Float[Array, ""]


@pytree
class RelativeOrbit:
    """Relative orbit. At the argument of latitude u it has, on a circular orbit and without drift,

    `x = -radial cos(u - radial_phase)`, `y = along_track + 2 radial sin(u - radial_phase)` and
    `z = cross_track sin(u - cross_track_phase)`. On an elliptic orbit these are the amplitudes 90 deg from perigee:
    that of `x` is constant, `z` and the offset vary as the target's distance r from the Earth, the oscillation of `y`
    as 1 + r/p with the semi-latus rectum p.

    Attributes:
        radial: () amplitude of the radial oscillation, semi-major axis times relative eccentricity [m]
        radial_phase: () argument of latitude of the lowest point [rad]
        cross_track: () amplitude across the orbit plane, semi-major axis times relative inclination [m]
        cross_track_phase: () argument of latitude of the upward passage through the target's orbit plane [rad]
        along_track: () offset along-track at the entry [m]
        drift_per_orbit: () change of the offset in a period, by a difference of the semi-major axes [m]
        join: () time in which the servicer reaches the relative orbit from its motion at the entry [s]
    """

    radial: Array
    radial_phase: Array
    cross_track: Array
    cross_track_phase: Array
    along_track: Array
    drift_per_orbit: Array
    join: Array


def state(reference: RelativeOrbit, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Scalar) -> Float[Array, "6"]:
    """Desired relative state in H [m, m/s] `elapsed` [s] after the entry, with the target's `orbit` then."""
    wanted = free_motion(orbit, elapsed, _constants(reference, orbit))
    return joined(entry, orbit, elapsed, reference.join, wanted)


def _constants(reference: RelativeOrbit, orbit: TargetOrbit) -> Float[Array, "6"]:
    """Constants of the free motion [m]."""
    eta_square = 1.0 - orbit.ex * orbit.ex - orbit.ey * orbit.ey
    return jnp.stack(
        [
            reference.along_track,
            reference.radial * jnp.cos(reference.radial_phase),
            reference.radial * jnp.sin(reference.radial_phase),
            reference.drift_per_orbit * eta_square * jnp.sqrt(eta_square) / (6.0 * math.pi),
            reference.cross_track * jnp.cos(reference.cross_track_phase),
            reference.cross_track * jnp.sin(reference.cross_track_phase),
        ]
    )
