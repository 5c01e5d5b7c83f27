"""Ranges of laser beams to the nearest surface of the target, and which of them come back."""

import math
from typing import Final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.core.vectors import across_axes, product
from rpojax.physics.plant_state import Truth
from rpojax.vision.surface.ray_triangle_intersection import nearest_hits

MOST_TRIANGLES: Final = 600
"""Triangles of a surface for ranges: as many as the loop searches one by one; a larger mesh is simplified."""
MATT_REFLECTIVITY: Final = 0.3
"""Reflectivity of a surface without a material: that of worn white paint and foil seen together [-]."""

TYPICAL_REACH: Final = math.sqrt(MATT_REFLECTIVITY * math.cos(math.radians(45.0)))
"""Reach on such a surface at 45 deg over that on a white one seen face-on: up to there flight software counts on it."""


@pytree
class TargetSurface:
    """Surface of the target in T, from its centre of mass.

    Attributes:
        triangles: (t, 3, 3) of the nominal target [m]
        reflectivity: (t,) over that of a white, matt surface [-]
        scale: () size of the true target over the nominal one [-]
    """

    triangles: Array
    reflectivity: Array
    scale: Array


@pytree
class Returns:
    """Beams that have come back.

    Attributes:
        distance: (r,) to the nearest surface [m], zero where there is none
        present: (r,) bool
    """

    distance: Array
    present: Array


def returns(
    truth: Truth, surface: TargetSurface, directions_B: Float[Array, "r 3"], reach: Float[Array, ""]
) -> Returns:
    """Returns of beams along unit vectors from the servicer's centre of mass.

    The power that a matt surface wider than the beam sends back falls with the square of the distance, with its
    reflectivity, and with the cosine of the angle of incidence (Degnan, Satellite Laser Ranging, 1993, radar link
    equation; Richmond and Cain, Direct-Detection LADAR Systems, 2010, chapter 1). `reach` [m] is the distance at which
    a white one seen face-on is just detected.
    """
    R_TB = product(quaternion.to_matrix(truth.q_TN), quaternion.to_matrix(truth.q_BN).T)
    directions_T = product(directions_B, R_TB.T)
    origin_T = quaternion.rotate(truth.q_TN, truth.r_ST_N) / surface.scale
    hits = nearest_hits(surface.triangles, origin_T, directions_T)
    met = jnp.isfinite(hits.distance)
    distance = jnp.where(met, hits.distance, 0.0) * surface.scale
    present = met & (distance**2 <= reach**2 * surface.reflectivity[hits.face] * hits.cosine)
    return Returns(distance=distance, present=present)


def within_cone(axis_B: Float[Array, "3"], half_angle: Float[Array, ""], pattern: Float[Array, "r 2"]) -> Array:
    """Unit vectors (r, 3) about an axis, by places in the unit disc; those of its border are `half_angle` [rad] off."""
    tangent = jnp.tan(half_angle)
    first, second = across_axes(axis_B)
    x, y = pattern[:, :1], pattern[:, 1:]
    lines = axis_B[None, :] + tangent * (x * first[None, :] + y * second[None, :])
    return lines / jnp.sqrt(1.0 + tangent**2 * (x * x + y * y))


def sunflower(count: int) -> np.ndarray:
    """(count, 2) places that fill the unit disc evenly (Vogel, 1979)."""
    number = np.arange(count)
    angle, radius = number * math.pi * (3.0 - math.sqrt(5.0)), np.sqrt((number + 0.5) / count)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def is_within(
    directions_B: Float[Array, "r 3"], boresight_B: Float[Array, "3"], half_angle: Array
) -> Bool[Array, " r"]:
    """Whether each direction is at most `half_angle` [rad] from the boresight."""
    return jnp.sum(directions_B * gradient_safe.normalize(boresight_B)[None, :], axis=1) >= jnp.cos(half_angle)
