"""Deferred shading: one network call per ray, on the accumulated features of its samples.

After Hedman et al., "Baking Neural Radiance Fields", ICCV 2021. The network is given the surface normal, the Sun, the
half-vector and the transmittance towards the Sun.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from rpojax.vision.multilayer_perceptron import apply_layers
from rpojax.vision.radiance_field.grid_field import LATENT_SIZE, GridField, grid_bounds
from rpojax.vision.radiance_field.positional_encoding import positional_encoding

FREQUENCIES = 4
SHADING_INPUTS = LATENT_SIZE + 3 + 3 + 3 + 9 + 6 * FREQUENCIES
RADIANCE_GAMMA = 2.2
"""Radiance is this power of a network's output, which is close to an sRGB code."""
_TINY = 1e-6


def normalized(vector: Array) -> Array:
    """Unit vector; zero for a zero."""
    return vector * jax.lax.rsqrt(jnp.sum(vector * vector) + _TINY)


def shade(
    field: GridField, latent: Array, point: Array, normal: Array, view: Array, sun: Array, transmittance: Array
) -> Array:
    """Linear colour (3,) of a surface point from its latent features and the terms of a shading formula.

    `view` and `sun` are unit vectors from the point, `transmittance` is the fraction of sunlight that reaches it.
    """
    half = normalized(view + sun)
    cosine, facing = jnp.sum(normal * sun), jnp.sum(normal * view)
    gloss = jnp.maximum(jnp.sum(normal * half), 0.0)
    lit = jax.nn.relu(cosine) * transmittance
    lobes = [transmittance * gloss**power for power in (8, 32, 128, 512)]
    low, high = grid_bounds(field)
    place = (2.0 * point - low - high) / jnp.sqrt(jnp.sum((high - low) ** 2))
    terms = jnp.stack([cosine, lit, transmittance, facing, gloss, *lobes])
    inputs = jnp.concatenate([latent, normal, view, sun, terms, positional_encoding(place, FREQUENCIES)])
    return jax.nn.sigmoid(apply_layers(field.network, inputs)) ** RADIANCE_GAMMA
