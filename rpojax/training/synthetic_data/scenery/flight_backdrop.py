"""Backdrops as the rendered camera of the closed loop sees them: its stars, ground, clouds, haze and air."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.training.synthetic_data.scenery.earth_textures import EarthTextures
from rpojax.training.synthetic_data.scenery.earth_views import EarthView, random_earth_view
from rpojax.vision.imaging.sky_background import background
from rpojax.vision.imaging.sky_maps import Sky, random_sky
from rpojax.vision.pinhole import Intrinsics

Rng = np.random.Generator

_SKIES = 12
"""Different skies, each with its own stars and clouds."""
_LIMB_SHARE = 0.4
_FIRST_SEED = 1000
"""Of the skies; scenarios have small seeds."""


def paint_flight_backdrop(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """Linear image (p, p, 3) of the Earth or its limb by `vision.imaging.sky_background`, by day or in twilight."""
    limb = bool(rng.random() < _LIMB_SHARE)
    view = random_earth_view(rng, earth, size_px, limb, sun_height=(-0.2, 1.0))
    return np.asarray(_render(_sky(int(rng.integers(_SKIES))), *_camera(view, size_px), size_px=size_px))


@functools.lru_cache(maxsize=_SKIES)
def _sky(index: int) -> Sky:
    """A sky, of which clouds cover between a tenth and nine tenths."""
    return random_sky(_FIRST_SEED + index, 0.1 + 0.8 * index / (_SKIES - 1))


def _camera(view: EarthView, size_px: int) -> tuple[Intrinsics, jax.Array, jax.Array, jax.Array]:
    """Intrinsics, R_KN, position and direction to the Sun of a view, with Earth axes as N."""
    center = jnp.full(2, 0.5 * size_px, jnp.float32)
    intrinsics = Intrinsics(focal_px=jnp.asarray(view.focal_px, jnp.float32), center_px=center)
    axes, position, sun = (jnp.asarray(values, jnp.float32) for values in (view.axes, view.position, view.sun))
    return intrinsics, axes, position, sun


@functools.partial(jax.jit, static_argnames="size_px")
def _render(
    sky: Sky, intrinsics: Intrinsics, R_KN: jax.Array, position: jax.Array, sun: jax.Array, size_px: int
) -> jax.Array:
    return background(sky, intrinsics, size_px, size_px, R_KN, position, sun, jnp.zeros((), jnp.float32))
