"""Deferred shading: one evaluation per ray, on the accumulated features of its samples.

After Hedman et al., "Baking Neural Radiance Fields", ICCV 2021. Sunlight is what a network makes of the terms of a
shading formula, plus a microfacet lobe whose mirror colour and roughness are linear in the features, since a network
does not reach the brightness of a glint. Fill light has a network of its own.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from rpojax.vision.multilayer_perceptron import apply_layers
from rpojax.vision.radiance_field.grid_field import LATENT_SIZE, GridField, grid_bounds
from rpojax.vision.radiance_field.positional_encoding import positional_encoding

FREQUENCIES = 4
SHADING_INPUTS = LATENT_SIZE + 3 + 3 + 3 + 9 + 6 * FREQUENCIES
FILL_INPUTS = LATENT_SIZE + 4 + 6 * FREQUENCIES
MATERIAL_OUTPUTS = 4
"""Mirror colour at normal incidence, and roughness."""
RADIANCE_GAMMA = 2.2
"""Radiance is this power of a network's output, which is close to an sRGB code."""
_IRRADIANCE = 2.2
"""Of the Sun, by the radiance of the white level: white paper that faces it has 70 % of that level."""
_LEAST_WIDTH = 0.02
"""Least width of a microfacet lobe: a polished panel."""
_LEAST_COSINE = 0.03
_TINY = 1e-6


def normalized(vector: Array) -> Array:
    """Unit vector; zero for a zero."""
    return vector * jax.lax.rsqrt(jnp.sum(vector * vector) + _TINY)


def shade(
    field: GridField, latent: Array, point: Array, normal: Array, view: Array, sun: Array, transmittance: Array
) -> Array:
    """Linear colour (3,) under the Sun of a surface point from its latent features and the terms of a shading formula.

    `view` and `sun` are unit vectors from the point, `transmittance` is the fraction of sunlight that reaches it.
    """
    half = normalized(view + sun)
    cosine, facing = jnp.sum(normal * sun), jnp.sum(normal * view)
    gloss = jnp.maximum(jnp.sum(normal * half), 0.0)
    lit = jax.nn.relu(cosine) * transmittance
    lobes = [transmittance * gloss**power for power in (8, 32, 128, 512)]
    terms = jnp.stack([cosine, lit, transmittance, facing, gloss, *lobes])
    inputs = jnp.concatenate([latent, normal, view, sun, terms, _encoded_place(field, point)])
    smooth = jax.nn.sigmoid(apply_layers(field.network, inputs)) ** RADIANCE_GAMMA
    material = apply_layers(field.material, latent)
    mirror = microfacet_lobe(
        jax.nn.sigmoid(material[:3]), jax.nn.sigmoid(material[3]), cosine, facing, gloss, jnp.sum(view * half)
    )
    return smooth + (_IRRADIANCE * transmittance) * mirror


def shade_fill(field: GridField, latent: Array, point: Array, normal: Array, view: Array, fill: Array) -> Array:
    """Linear colour (3,) of a surface point under fill light of the Sun's irradiance.

    `view` and `fill`, to the middle of that light, are unit vectors from the point.
    """
    facing = jnp.sum(normal * view)
    mirrored = 2.0 * facing * normal - view
    terms = jnp.stack([jnp.sum(normal * fill), jnp.sum(mirrored * fill), facing, jnp.maximum(1.0 - facing, 0.0) ** 5])
    inputs = jnp.concatenate([latent, terms, _encoded_place(field, point)])
    return jax.nn.sigmoid(apply_layers(field.fill_network, inputs)) ** RADIANCE_GAMMA


def microfacet_lobe(
    mirror: Array, roughness: Array, cosine: Array, facing: Array, gloss: Array, incidence: Array
) -> Array:
    """Radiance (3,) by unit irradiance, times the cosine to the light, of the lobe of Walter et al., EGSR 2007 ("GGX").

    `mirror` (3,) is the reflectance at normal incidence, of which Schlick's approximation makes that at others;
    `roughness` is the root of the width. `cosine`, `facing` and `gloss` are the cosines between the normal and the
    light, the view, and the half-vector; `incidence` that between view and half-vector.
    """
    width = jnp.maximum(roughness * roughness, _LEAST_WIDTH)
    square = width * width
    cosine, facing = jnp.maximum(cosine, 0.0), jnp.maximum(facing, _LEAST_COSINE)
    # (1 - cos^2) (1 - 1 / w^2) without cancellation at the peak in single precision.
    spread = jnp.maximum(1.0 - gloss * gloss, 0.0)
    density = square / (jnp.pi * (square + spread * (1.0 - square)) ** 2)
    fresnel = mirror + (1.0 - mirror) * jnp.maximum(1.0 - incidence, 0.0) ** 5

    def masking(cosine: Array) -> Array:
        return cosine + jnp.sqrt(square + (1.0 - square) * cosine * cosine)

    # Smith's term over the four cosines of the formula, one of which the cosine to the light cancels.
    visible = 1.0 / (masking(jnp.maximum(cosine, _LEAST_COSINE)) * masking(facing))
    return fresnel * (density * visible * cosine)


def _encoded_place(field: GridField, point: Array) -> Array:
    low, high = grid_bounds(field)
    return positional_encoding((2.0 * point - low - high) / jnp.sqrt(jnp.sum((high - low) ** 2)), FREQUENCIES)
