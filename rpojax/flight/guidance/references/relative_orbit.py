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

from rpojax.core.declared_numbers import number
from rpojax.core.numerics.trigonometric_series import cos_sin
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, advanced, constants_of_motion, free_motion, unit_rate
from rpojax.core.pytree import pytree, select
from rpojax.flight.guidance.references.phase_entry import PhaseEntry, smooth_step

Scalar = Float[Array, ""]


@pytree
class RelativeOrbit:
    """Relative orbit. At the argument of latitude u it has, on a circular orbit and without drift,

    `x = -radial cos(u - radial_phase)`, `y = along_track + 2 radial sin(u - radial_phase)` and
    `z = cross_track sin(u - cross_track_phase)`. On an elliptic orbit these are the amplitudes 90 deg from perigee:
    that of `x` is constant, `z` and the offset vary as the target's distance r from the Earth, the oscillation of `y`
    as 1 + r/p with the semi-latus rectum p.
    """

    radial: Array = number(
        "amplitude of the radial oscillation, semi-major axis times relative eccentricity",
        unit="m",
        at_least=0.0,
        default=0.0,
    )
    radial_phase: Array = number("argument of latitude of the lowest point", unit="deg", default=0.0)
    cross_track: Array = number(
        "amplitude across the orbit plane, semi-major axis times relative inclination",
        unit="m",
        at_least=0.0,
        default=0.0,
    )
    cross_track_phase: Array = number(
        "argument of latitude of the upward passage through the target's orbit plane", unit="deg", default=0.0
    )
    along_track: Array = number("offset along-track at the entry", unit="m", default=0.0)
    drift_per_orbit: Array = number(
        "change of the offset in a period, by unequal semi-major axes", unit="m", default=0.0
    )
    join: Array = number(
        "time in which the servicer reaches the relative orbit from its motion at the entry",
        unit="s",
        at_least=0.0,
        default=0.0,
    )


def state(reference: RelativeOrbit, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Scalar) -> Float[Array, "6"]:
    """Desired relative state in H [m, m/s] `elapsed` [s] after the entry, with the target's `orbit` then.

    The place of the motion is that of the target by its argument of latitude; its constants are fixed at the entry.
    During the join the shape goes over from that of the motion before the entry in the first half of the time, so that
    the separation in height and across the orbit plane is there early. The offset takes the whole time, by a drift: at
    the height of a co-elliptic orbit the motion is nearly free.
    """
    # A closed orbit that is joined at once keeps nothing of the entry but rounding: it stays as it was.
    lasts = (reference.join > 0.0) | (reference.drift_per_orbit != 0.0)
    at_entry, known = select(lasts, (entry.orbit, entry.orbit), (advanced(orbit, -elapsed), orbit))
    start = constants_of_motion(at_entry, entry.relative_state)
    before = _with_drift_along(known, start, -1.0)
    change = _with_drift_along(known, _constants(reference, known), -1.0) - before
    shape_share, shape_slope, _ = smooth_step(elapsed, _SHAPE_SHARE * reference.join)
    share, slope, curvature = smooth_step(elapsed, reference.join)
    blend, blend_slope = before + shape_share * change, shape_slope * change
    rate = 3.0 * unit_rate(known)
    gap = change[0] + rate * elapsed * change[3]
    offset = before[0] + rate * elapsed * before[3] + share * gap
    drift = before[3] + share * change[3] + slope * gap / rate
    drift_change = 2.0 * slope * change[3] + curvature * gap / rate
    zero = jnp.zeros_like(elapsed)
    free = jnp.stack([offset, blend[1], blend[2], drift, blend[4], blend[5]])
    forced = jnp.stack([zero, blend_slope[1], blend_slope[2], drift_change, blend_slope[4], blend_slope[5]])
    motion = free_motion(orbit, zero, _with_drift_along(orbit, free, 1.0))
    velocity = free_motion(orbit, zero, _with_drift_along(orbit, forced, 1.0))[:3]
    return motion + jnp.concatenate([jnp.zeros_like(velocity), velocity])


def _with_drift_along(orbit: TargetOrbit, constants: Float[Array, "6"], sign: float) -> Float[Array, "6"]:
    """Constants [m] with the eccentricity vector of a servicer ahead on the target's own orbit added or subtracted.

    Without it, a drift changes none of them but the offset.
    """
    offset = sign * constants[0]
    ahead = jnp.stack([constants[1] + orbit.ey * offset, constants[2] - orbit.ex * offset])
    return jnp.concatenate([constants[:1], ahead, constants[3:]])


def _constants(reference: RelativeOrbit, orbit: TargetOrbit) -> Float[Array, "6"]:
    """Constants of the free motion [m]."""
    eta_square = 1.0 - orbit.ex * orbit.ex - orbit.ey * orbit.ey
    radial_cos, radial_sin = cos_sin(reference.radial_phase)
    across_cos, across_sin = cos_sin(reference.cross_track_phase)
    return jnp.stack(
        [
            reference.along_track,
            reference.radial * radial_cos,
            reference.radial * radial_sin,
            reference.drift_per_orbit * eta_square * jnp.sqrt(eta_square) / (6.0 * math.pi),
            reference.cross_track * across_cos,
            reference.cross_track * across_sin,
        ]
    )


_SHAPE_SHARE = 0.5
"""Share of the join in which the shape is reached [-]. A choice: the separation across the track is there before the
offset, and the shape has an orbit of its own to change in where the join takes two."""
