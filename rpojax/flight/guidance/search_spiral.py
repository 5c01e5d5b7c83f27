"""Finding the target: what counts as a sighting, and the spiral flown when there is none."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics.trigonometric_series import cos_sin
from rpojax.flight.guidance.pointing_modes import PointingTuning
from rpojax.flight.guidance.target_pointing import bearing_sigma
from rpojax.flight.navigation.orbit_filter import OrbitEstimate

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


def wrap_spiral_time(pointing: PointingTuning, estimate: OrbitEstimate, time: Scalar) -> Scalar:
    """Time along the spiral [s]; back to its start once it has left the projected uncertainty."""
    radius = jnp.minimum(pointing.search_sigmas * bearing_sigma(estimate), pointing.search_radius_max)
    duration = jnp.maximum(radius * jnp.sqrt(radius) / _spiral_growth(pointing), 10.0)
    return jnp.where(time > duration, 1.0, time)


def spiral_offset(pointing: PointingTuning, time: Scalar) -> tuple[Vector, Vector]:
    """Turn of the camera [rad] and its rate [rad/s] on the search spiral."""
    growth = _spiral_growth(pointing)
    # The first second is left out: there the spiral's radius would start at an infinite rate.
    volume = growth * (time + 1.0)
    radius = jnp.exp(2.0 / 3.0 * jnp.log(volume))
    radius_rate = 2.0 / 3.0 * growth / jnp.sqrt(radius)
    radians_per_radius = 2.0 * math.pi / pointing.search_pitch
    c, s = cos_sin(radians_per_radius * radius)
    none = jnp.zeros_like(radius)
    outward, around = jnp.stack([c, s, none]), jnp.stack([-s, c, none])
    return radius * outward, radius_rate * (outward + radians_per_radius * radius * around)


def _spiral_growth(pointing: PointingTuning) -> Scalar:
    """Rate of radius^(3/2) [rad^(3/2)/s] on an Archimedean spiral flown at constant centripetal acceleration."""
    return 0.75 * pointing.search_pitch * jnp.sqrt(pointing.search_acceleration) / math.pi


def count_detections(before: Scalar, accepted: Flag, visible: Flag, looking_away: Flag) -> Scalar:
    """Accepted boxes of late; planned look-aways leave the count as it is, darkness ends it."""
    count = jnp.where(accepted, before + 1.0, jnp.where(looking_away, before, _DETECTION_DECAY * before))
    return jnp.where(visible, jnp.minimum(count, _MAX_DETECTION_COUNT), 0.0)


_DETECTION_DECAY = 0.8
"""What is left of the count of sightings after a frame without one."""


_MAX_DETECTION_COUNT = 10.0
"""The count goes no higher, so that it is forgotten within half a minute."""


ACQUISITION_COUNT = 2.5
"""From so many sightings on the target counts as seen: false boxes come once in twenty frames and rarely agree."""


SINGLE_BOX_HOLD_TIME = 5.0
"""How long a single box keeps the camera from searching [s]."""
