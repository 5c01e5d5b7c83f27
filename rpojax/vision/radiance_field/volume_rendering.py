"""Volume rendering of a grid field: emission and absorption along a ray, its shadow ray, and one shading call."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from rpojax.core.pytree import pytree
from rpojax.vision.radiance_field.deferred_shading import normalized, shade, shade_fill
from rpojax.vision.radiance_field.grid_field import GridField
from rpojax.vision.radiance_field.grid_interpolation import (
    grid_density,
    interpolate_density,
    interpolate_features,
    trilinear_nodes,
)
from rpojax.vision.radiance_field.occupancy_sampling import sample_distances

SAMPLES = 16
"""Samples of a ray from the camera."""
SHADOW_SAMPLES = 6
"""Samples of a ray towards the Sun."""
_TINY = 1e-6


@pytree
class RenderedRays:
    """Colours, alpha, depth and normal of rays.

    Attributes:
        sunlit: (n, 3) linear radiance under the Sun, 1 = white level, times alpha
        filled: (n, 3) the same under fill light of the Sun's irradiance
        alpha: (n,) fraction that the target covers
        depth: (n,) distance [m] times alpha
        normal: (n, 3) unit normal towards the viewer in T times alpha; zero for a field without one
    """

    sunlit: Array
    filled: Array
    alpha: Array
    depth: Array
    normal: Array


def render_grid_ray(
    field: GridField, origin: Array, direction: Array, sun: Array, fill: Array, shift: Array
) -> RenderedRays:
    """One ray rendered; `shift` in -0.5 to 0.5 moves its samples."""
    distance, length = sample_distances(field, origin, direction, SAMPLES, shift)
    optical_depth, features, depth = _accumulate_samples(field, origin, direction, distance, length)
    alpha = 1.0 - jnp.exp(-optical_depth)
    inverse_alpha = 1.0 / (alpha + _TINY)
    features, point = features * inverse_alpha, origin + depth * inverse_alpha * direction
    normal = normalized(features[:3])
    normal = jnp.where(jnp.sum(normal * direction) > 0.0, -normal, normal)
    # The derivative of a shadow by the density that casts it is left out: it costs more than the rest of the ray.
    transmittance = _sun_transmittance(
        *jax.lax.stop_gradient((field, point + 1.5 * field.spacing * (normal + sun), sun))
    )
    sunlit = shade(field, features[3:], point, normal, -direction, sun, transmittance)
    filled = shade_fill(field, features[3:], point, normal, -direction, fill)
    return RenderedRays(sunlit=sunlit * alpha, filled=filled * alpha, alpha=alpha, depth=depth, normal=normal * alpha)


def _accumulate_samples(
    field: GridField, origin: Array, direction: Array, distance: Array, length: Array
) -> tuple[Array, ...]:
    """Optical depth, and features (3 + LATENT_SIZE,) and distance [m] weighted by each sample's contribution."""

    def accumulate(
        carry: tuple[Array, Array, Array], sample: tuple[Array, Array]
    ) -> tuple[tuple[Array, Array, Array], None]:
        optical_depth, features, depth = carry
        sample_distance, sample_length = sample
        rows, corner_weights = trilinear_nodes(field, origin + sample_distance * direction)
        thickness = interpolate_density(field, rows, corner_weights) * sample_length
        weight = jnp.exp(-optical_depth) * (1.0 - jnp.exp(-thickness))
        contribution = weight * interpolate_features(field, rows, corner_weights)
        return (optical_depth + thickness, features + contribution, depth + weight * sample_distance), None

    zero = jnp.zeros((), jnp.float32)
    start = (zero, jnp.zeros(field.features.shape[1:], jnp.float32), zero)
    return jax.lax.scan(accumulate, start, (distance, length))[0]


def _sun_transmittance(field: GridField, origin: Array, direction: Array) -> Array:
    """Fraction of the light from a direction that reaches a point."""
    distance, length = sample_distances(field, origin, direction, SHADOW_SAMPLES, jnp.zeros((), jnp.float32))

    def accumulate(optical_depth: Array, sample: tuple[Array, Array]) -> tuple[Array, None]:
        return optical_depth + grid_density(field, origin + sample[0] * direction) * sample[1], None

    return jnp.exp(-jax.lax.scan(accumulate, jnp.zeros((), jnp.float32), (distance, length))[0])
