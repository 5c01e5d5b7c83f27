"""Finding the target: what counts as a sighting, and the spiral flown when there is none."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics.trigonometric_series import cos_sin
from rpojax.flight.guidance.pointing_modes import Pointing
from rpojax.flight.guidance.target_pointing import bearing_uncertainty
from rpojax.flight.navigation.orbit_filter import OrbitEstimate

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


def search_clock(pointing: Pointing, estimate: OrbitEstimate, time: Scalar) -> Scalar:
    """Time along the spiral [s]; back to its start once it has left the projected uncertainty."""
    radius = jnp.minimum(pointing.search_sigmas * bearing_uncertainty(estimate), pointing.search_radius_max)
    full = jnp.maximum(radius * jnp.sqrt(radius) / _spiral_growth(pointing), 10.0)
    return jnp.where(time > full, 1.0, time)


def spiral(pointing: Pointing, time: Scalar) -> tuple[Vector, Vector]:
    """Turn of the camera [rad] and its rate [rad/s] on the search spiral."""
    growth = _spiral_growth(pointing)
    # The first second is left out: there the spiral's radius would start at an infinite rate.
    volume = growth * (time + 1.0)
    radius = jnp.exp(2.0 / 3.0 * jnp.log(volume))
    radius_rate = 2.0 / 3.0 * growth / jnp.sqrt(radius)
    turns = 2.0 * math.pi / pointing.search_pitch
    c, s = cos_sin(turns * radius)
    none = jnp.zeros_like(radius)
    outward, around = jnp.stack([c, s, none]), jnp.stack([-s, c, none])
    return radius * outward, radius_rate * (outward + turns * radius * around)


def _spiral_growth(pointing: Pointing) -> Scalar:
    """Rate of radius^(3/2) [rad^(3/2)/s] on an Archimedean spiral flown at constant centripetal acceleration."""
    return 0.75 * pointing.search_pitch * jnp.sqrt(pointing.search_acceleration) / math.pi


def count_sightings(before: Scalar, accepted: Flag, visible: Flag, looking_away: Flag) -> Scalar:
    """Accepted boxes of late; planned look-aways leave the count as it is, darkness ends it."""
    count = jnp.where(accepted, before + 1.0, jnp.where(looking_away, before, _SIGHTING_FADES * before))
    return jnp.where(visible, jnp.minimum(count, _SIGHTINGS_KEPT), 0.0)


_SIGHTING_FADES = 0.8
"""What is left of the count of sightings after a frame without one."""


_SIGHTINGS_KEPT = 10.0
"""The count goes no higher, so that it is forgotten within half a minute."""


SURE = 2.5
"""From so many sightings on the target counts as seen: false boxes come once in twenty frames and rarely agree."""


STARE = 5.0
"""How long a single box keeps the camera from searching [s]."""
