"""Sunlight reflected by the Earth onto a spacecraft, as the irradiance of a surface that faces its centre."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

ALBEDO = 0.3
"""Of the Earth as a whole (Stephens et al., Reviews of Geophysics, 2015); clouds and ground scatter evenly."""
_RINGS, _SECTORS = 4, 12
_LEAST_HEIGHT = 1e-3


def earth_shine(position: Float[Array, "3"], sun: Float[Array, "3"]) -> Float[Array, ""]:
    """Irradiance () of a surface that faces the Earth's centre, relative to the solar irradiance.

    `position` is that of the surface from the centre [Earth radii], `sun` a unit vector. The integral over the disc
    of radiance times cosine is a sum over 48 parts of equal weight. Night side and ground beyond the terminator are
    dark, so that little is left where the Earth hides the Sun.
    """
    radius = jnp.maximum(jnp.sqrt(jnp.sum(position * position)), 1.0 + _LEAST_HEIGHT)
    up = position / radius
    height = jnp.sum(up * sun)
    level = jnp.sqrt(jnp.maximum(1.0 - height * height, 0.0))
    # Squares of the sine of the angle from nadir at even parts: those of equal cosine-weighted solid angle.
    edge = 1.0 / (radius * radius)
    sine = jnp.sqrt(edge * ((jnp.arange(_RINGS, dtype=edge.dtype) + 0.5) / _RINGS))
    cosine = jnp.sqrt(1.0 - sine * sine)
    distance = radius * cosine - jnp.sqrt(jnp.maximum(1.0 - (radius * sine) ** 2, 0.0))
    upward, sideways = radius - distance * cosine, distance * sine
    azimuth = jnp.cos((2.0 * np.pi / _SECTORS) * (jnp.arange(_SECTORS, dtype=edge.dtype) + 0.5))
    zenith_cosine = upward[:, None] * height + sideways[:, None] * azimuth[None, :] * level
    return ALBEDO * edge * jnp.mean(jax.nn.relu(zenith_cosine))
