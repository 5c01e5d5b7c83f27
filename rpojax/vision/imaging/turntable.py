"""Turntable views of a radiance field."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.vision.imaging.contact_sheets import over_backdrop
from rpojax.vision.pinhole import pinhole_intrinsics
from rpojax.vision.radiance_field.ray_budget import choose_ray_sampling
from rpojax.vision.radiance_field.render_image import Light, render_target
from rpojax.vision.radiance_field.target_field import RadianceField, bounding_sphere

_FIELD_OF_VIEW = np.radians(26.0)
_FILL = 0.95
_FILL_LIGHT = 0.1
"""Irradiance by light from below, by the Sun's: the Earth in the morning."""


def camera_azimuths(frames: int, first_deg: float) -> np.ndarray:
    """Directions (frames,) of the cameras of a turntable, from the x axis towards y [deg]."""
    return (first_deg + 360.0 * np.arange(frames) / frames) % 360.0


def render_turntable(
    field: RadianceField, azimuths_deg: np.ndarray, size_px: int, sun: np.ndarray, elevation_deg: float
) -> Iterator[np.ndarray]:
    """Linear images (p, p, 3) from cameras round the field's z axis at one elevation, over a dim backdrop."""
    center, radius = (np.asarray(value) for value in bounding_sphere(field))
    distance = radius / (_FILL * np.tan(0.5 * _FIELD_OF_VIEW))
    intrinsics = pinhole_intrinsics(jnp.asarray(_FIELD_OF_VIEW), size_px, size_px)
    sampling = choose_ray_sampling(field, float(intrinsics.focal_px), float(distance), oversampling=1.0)
    sun_T = jnp.asarray(sun / np.linalg.norm(sun), jnp.float32)
    below = jnp.asarray([0.0, 0.0, -1.0], jnp.float32)
    elevation = np.radians(elevation_deg)

    @jax.jit
    def render_view(field: RadianceField, position: jax.Array, rotation: jax.Array) -> tuple[jax.Array, jax.Array]:
        light = Light(sun_T=sun_T, sunlight=jnp.float32(1.0), fill_T=below, fill=jnp.float32(_FILL_LIGHT))
        frame = render_target(field, intrinsics, size_px, size_px, sampling, position, rotation, light)
        return frame.color, frame.alpha

    for azimuth in np.radians(azimuths_deg):
        away = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
        x = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        rotation = np.stack([x, np.cross(-away, x), -away])
        color, alpha = render_view(field, *(jnp.asarray(v, jnp.float32) for v in (center + distance * away, rotation)))
        yield over_backdrop(np.asarray(color), np.asarray(alpha))
