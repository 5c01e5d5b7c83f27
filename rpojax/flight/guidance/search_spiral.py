"""Archimedean spiral on which the camera searches around the estimated target."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics.trigonometric_series import arctan2, cos_sin
from rpojax.flight.guidance.line_of_sight_uncertainty import uncertainty_cone
from rpojax.flight.guidance.pointing_tuning import PointingTuning
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


def spiral_duration(pointing: PointingTuning, estimate: OrbitEstimate) -> Scalar:
    """Time of a search [s] after which it has left the projected uncertainty and restarts.

    A search of more than the near directions begins with these: they are the most likely ones, and all take long.
    """
    radius = jnp.minimum(_uncertainty_radius(pointing, estimate), pointing.search_radius_max)
    farther = jnp.where(radius > _NEAR, _time_to_radius(pointing, radius), 0.0)
    return jnp.maximum(_time_to_radius(pointing, jnp.minimum(radius, _NEAR)) + farther, _SHORTEST_SEARCH)


def _time_to_radius(pointing: PointingTuning, radius: Scalar) -> Scalar:
    """Time along one spiral [s] to a radius [rad]."""
    near = jnp.minimum(radius, _radius_of_full_speed(pointing))
    c_near, c_radius = cos_sin(near)[0], cos_sin(radius)[0]
    return near * jnp.sqrt(near) / _spiral_growth(pointing) + (c_near - c_radius) / _band_rate(pointing)


def covers_uncertainty(pointing: PointingTuning, estimate: OrbitEstimate) -> Bool[Array, ""]:
    """True if the spiral covers all directions that the projected uncertainty allows."""
    return _uncertainty_radius(pointing, estimate) < pointing.search_radius_max


def _uncertainty_radius(pointing: PointingTuning, estimate: OrbitEstimate) -> Scalar:
    return uncertainty_cone(estimate, pointing.search_sigmas)


def spiral_pace(dt: float) -> float:
    """Time along the spiral per time, with `dt` [s] between frames: a slow camera follows it at one second per frame.

    So its frames overlap, and the straight path between two of them stays near the spiral, as at one frame per second.
    """
    return min(1.0 / dt, 1.0)


def spiral_offset(pointing: PointingTuning, time: Scalar) -> tuple[Vector, Vector]:
    """Rotation vector of the camera [rad] and angular velocity [rad/s] at a time of the search [s], at pace 1."""
    first = _time_to_radius(pointing, jnp.full_like(time, _NEAR))
    along = jnp.where(time > first, time - first, time)
    # The first second is left out: there the spiral's radius would start at an infinite rate.
    radius, radius_rate = _radius(pointing, along + 1.0)
    radians_per_radius = 2.0 * math.pi / pointing.search_pitch
    c, s = cos_sin(radians_per_radius * radius)
    none = jnp.zeros_like(radius)
    outward, around = jnp.stack([c, s, none]), jnp.stack([-s, c, none])
    # It is not the derivative of the rotation vector: Shuster, A Survey of Attitude Representations, 1993.
    c, s = cos_sin(radius)
    axial = jnp.array([0.0, 0.0, 1.0], dtype=radius.dtype)
    turning = s * around - (1.0 - c) * axial
    return radius * outward, radius_rate * (outward + radians_per_radius * turning)


def _radius(pointing: PointingTuning, time: Scalar) -> tuple[Scalar, Scalar]:
    """Angle from the middle of the spiral [rad] and its rate [rad/s] at a time from there [s].

    Constant centripetal acceleration at first, then constant speed over the sphere.
    """
    growth, near, rate = _spiral_growth(pointing), _radius_of_full_speed(pointing), _band_rate(pointing)
    at_full_speed = near * jnp.sqrt(near) / growth
    accelerating = jnp.exp(2.0 / 3.0 * jnp.log(growth * jnp.minimum(time, at_full_speed)))
    cosine = jnp.maximum(cos_sin(near)[0] - rate * jnp.maximum(time - at_full_speed, 0.0), -_LARGEST_COSINE)
    sine = jnp.sqrt(1.0 - cosine * cosine)
    steady = arctan2(sine, cosine)
    is_steady = time > at_full_speed
    radius = jnp.where(is_steady, steady, accelerating)
    return radius, jnp.where(is_steady, rate / sine, 2.0 / 3.0 * growth / jnp.sqrt(accelerating))


def _spiral_growth(pointing: PointingTuning) -> Scalar:
    """Rate of radius^(3/2) [rad^(3/2)/s] on an Archimedean spiral with constant centripetal acceleration."""
    return 0.75 * pointing.search_pitch * jnp.sqrt(pointing.search_acceleration) / math.pi


def _radius_of_full_speed(pointing: PointingTuning) -> Scalar:
    """Radius [rad] at which the centripetal acceleration has led to the greatest speed."""
    return (_PITCHES_PER_FRAME * pointing.search_pitch) ** 2 / pointing.search_acceleration


def _band_rate(pointing: PointingTuning) -> Scalar:
    """Rate of the cosine of the radius [1/s] at the greatest speed: that of the area that is searched."""
    return _PITCHES_PER_FRAME * pointing.search_pitch**2 / (2.0 * math.pi)


_PITCHES_PER_FRAME = 0.5
"""Greatest way along the spiral from frame to frame over its pitch: a target is in two frames at least, so that one box
can confirm the other [-]. In one frame alone targets were lost (experiments/unseen_missions)."""


_NEAR = math.radians(45.0)
"""Radius of the directions that are searched first [rad]. A choice: they are 15 % of all, which take half an hour
(experiments/unseen_missions)."""


_SHORTEST_SEARCH = 10.0
"""Shortest time of a search [s]. A choice: ten frames at 1 Hz or less: misses alone do not widen the estimate."""


_LARGEST_COSINE = 0.9999
"""Bound of the cosine of the radius, beyond the largest search radius [-]: that of 179.2 deg."""
