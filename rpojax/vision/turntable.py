"""A field seen from all round."""

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.vision.field import Field, bounding_ball
from rpojax.vision.pinhole import lens
from rpojax.vision.region import sampling
from rpojax.vision.render import render_frame

_FIELD_OF_VIEW = np.radians(26.0)
_FILL = 0.85


def turntable(field: Field, frames: int, size_px: int, sun: np.ndarray, elevation_deg: float) -> np.ndarray:
    """Linear pictures (frames, p, p, 3) from a camera that goes round the field's z axis at one height."""
    middle, radius = (np.asarray(value) for value in bounding_ball(field))
    distance = radius / (_FILL * np.tan(0.5 * _FIELD_OF_VIEW))
    optics = lens(jnp.asarray(_FIELD_OF_VIEW), size_px, size_px)
    rays = sampling(field, float(optics.focal_px), float(distance), oversampling=1.0)
    light = jnp.asarray(sun / np.linalg.norm(sun), jnp.float32)
    elevation = np.radians(np.clip(elevation_deg, -89.0, 89.0))

    @jax.jit
    def one(field: Field, position: jax.Array, rotation: jax.Array) -> jax.Array:
        lit = jnp.ones((), jnp.float32)
        return render_frame(field, optics, size_px, size_px, rays, position, rotation, light, lit).color

    pictures = []
    for azimuth in 2.0 * np.pi * np.arange(frames) / frames:
        away = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
        x = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        rotation = np.stack([x, np.cross(-away, x), -away])
        pictures.append(one(field, *(jnp.asarray(v, jnp.float32) for v in (middle + distance * away, rotation))))
    return np.stack([np.asarray(picture) for picture in pictures])
