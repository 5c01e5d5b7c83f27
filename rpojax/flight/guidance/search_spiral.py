"""Archimedean spiral on which the camera searches around the estimated target."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics.trigonometric_series import cos_sin
from rpojax.flight.guidance.line_of_sight_uncertainty import bearing_sigma
from rpojax.flight.guidance.pointing_tuning import PointingTuning
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


def spiral_duration(pointing: PointingTuning, estimate: OrbitEstimate) -> Scalar:
    """Time along the spiral [s] at which it has left the projected uncertainty and restarts."""
    radius = jnp.minimum(_uncertainty_radius(pointing, estimate), pointing.search_radius_max)
    return jnp.maximum(radius * jnp.sqrt(radius) / _spiral_growth(pointing), 10.0)


def covers_uncertainty(pointing: PointingTuning, estimate: OrbitEstimate) -> Bool[Array, ""]:
    """True if the spiral covers all directions that the projected uncertainty allows."""
    return _uncertainty_radius(pointing, estimate) < pointing.search_radius_max


def _uncertainty_radius(pointing: PointingTuning, estimate: OrbitEstimate) -> Scalar:
    return pointing.search_sigmas * bearing_sigma(estimate)


def spiral_pace(dt: float) -> float:
    """Time along the spiral per time, with `dt` [s] between frames: a slow camera follows it at one second per frame.

    So its frames overlap, and the straight path between two of them stays near the spiral, as at one frame per second.
    """
    return min(1.0 / dt, 1.0)


def spiral_offset(pointing: PointingTuning, time: Scalar) -> tuple[Vector, Vector]:
    """Rotation vector of the camera [rad] and angular velocity [rad/s] at a time along the spiral [s], at pace 1."""
    growth = _spiral_growth(pointing)
    # The first second is left out: there the spiral's radius would start at an infinite rate.
    volume = growth * (time + 1.0)
    radius = jnp.exp(2.0 / 3.0 * jnp.log(volume))
    radius_rate = 2.0 / 3.0 * growth / jnp.sqrt(radius)
    radians_per_radius = 2.0 * math.pi / pointing.search_pitch
    c, s = cos_sin(radians_per_radius * radius)
    none = jnp.zeros_like(radius)
    outward, around = jnp.stack([c, s, none]), jnp.stack([-s, c, none])
    # It is not the derivative of the rotation vector: Shuster, A Survey of Attitude Representations, 1993.
    c, s = cos_sin(radius)
    axial = jnp.array([0.0, 0.0, 1.0], dtype=radius.dtype)
    turning = s * around - (1.0 - c) * axial
    return radius * outward, radius_rate * (outward + radians_per_radius * turning)


def _spiral_growth(pointing: PointingTuning) -> Scalar:
    """Rate of radius^(3/2) [rad^(3/2)/s] on an Archimedean spiral with constant centripetal acceleration."""
    return 0.75 * pointing.search_pitch * jnp.sqrt(pointing.search_acceleration) / math.pi
