"""Features of a view on which the outcome of rendering and detection depends, for the statistical camera."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.vision import bounding_box
from rpojax.vision.imaging.image_formation import Scene
from rpojax.vision.multilayer_perceptron import Layers, apply_layers

FEATURE_COUNT = 20
"""Numbers of `features`."""
MIN_OUTLINE_PX = 2.0
"""Smallest size of the visible outline, which scales the edge errors [px]. A choice: half of what is detected."""
_FEATURE_CLIP_SIGMA = 4.0
"""Features are clipped to this many sigma of the views of the fit: one of 16,000 normal ones is beyond."""
_LEAST_SQUARE = 1e-12
"""Added to the square of a distance that is divided by [m^2]."""
_LEAST_AREA = 1e-6
"""Area of the outline that is divided by, at least [px^2]."""
_AREA_IN_FRAME = 1.0
"""Area of the outline in the frame above which a box may be one of the target [px^2]: a pixel."""


def features(scene: Scene, outline: Float[Array, "4"], size_px: tuple[int, int]) -> Float[Array, " features"]:
    """Features of a view from its geometry and the target's outline [px], which may leave the frame.

    Attitude: directions of camera, Sun and image in target axes. Light: phase angle, direction of the Sun in the
    image. Size and place in the frame. Background: whether the Earth is behind, and how bright its light is there.
    """
    away_T = scene.r_KT_T * jax.lax.rsqrt(jnp.sum(scene.r_KT_T**2) + _LEAST_SQUARE)
    right_T, down_T = scene.R_KT[0], scene.R_KT[1]
    visible, size = visible_outline(outline, size_px)
    middle = bounding_box.box_center(visible)
    half = 0.5 * jnp.array(size_px, jnp.float32)
    behind, light = _earth_background(scene, away_T)
    visible_fraction = _area(visible) / jnp.maximum(_area(outline), _LEAST_AREA)
    return jnp.concatenate(
        [
            away_T,
            scene.sun_T,
            right_T,
            jnp.stack(
                [
                    jnp.sum(away_T * scene.sun_T),
                    jnp.sum(right_T * scene.sun_T),
                    jnp.sum(down_T * scene.sun_T),
                    jnp.log(size),
                    jnp.log(jnp.maximum(outline[2] - outline[0], 1.0) / jnp.maximum(outline[3] - outline[1], 1.0)),
                    visible_fraction,
                    scene.sunlight,
                    behind,
                    light,
                ]
            ),
            (middle - half) / half,
        ]
    )


def outputs_for(mean: Array, spread: Array, layers: Layers, view_features: Float[Array, " features"]) -> Array:
    """Outputs of a fitted network for features, of which the fit had that mean and 1 sigma (FEATURE_COUNT,)."""
    standard = jnp.clip((view_features - mean) / spread, -_FEATURE_CLIP_SIGMA, _FEATURE_CLIP_SIGMA)
    return apply_layers(layers, standard)


def visible_outline(outline: Float[Array, "4"], size_px: tuple[int, int]) -> tuple[Float[Array, "4"], Float[Array, ""]]:
    """The outline cut to the frame, and the geometric mean of its sides [px]."""
    visible, _ = bounding_box.clip_to_frame(outline, *size_px)
    return visible, jnp.maximum(bounding_box.box_size(visible), MIN_OUTLINE_PX)


def is_in_frame(outline: Float[Array, "4"], size_px: tuple[int, int]) -> Bool[Array, ""]:
    """Whether enough of the outline is in the frame for a box to be one of the target."""
    visible, _ = bounding_box.clip_to_frame(outline, *size_px)
    return _area(visible) > _AREA_IN_FRAME


def _area(edges: Array) -> Array:
    """Area of a box [px^2]."""
    sides = jnp.maximum(edges[2:] - edges[:2], 0.0)
    return sides[0] * sides[1]


def _earth_background(scene: Scene, away_T: Array) -> tuple[Array, Array]:
    """Whether the Earth is behind the target, and the cosine of the Sun's zenith angle on the ground there."""
    line_N = -jnp.sum(scene.R_KN * jnp.sum(scene.R_KT * away_T[None, :], axis=1)[:, None], axis=0)
    along = jnp.sum(line_N * scene.position_N)
    nearest = jnp.sum(scene.position_N**2) - along * along
    hit = (along < 0.0) & (nearest < 1.0)
    distance = -along - jnp.sqrt(jnp.where(hit, 1.0 - nearest, 0.0))
    ground = scene.position_N + distance * line_N
    light = jnp.where(hit, jnp.maximum(jnp.sum(ground * scene.sun_N), 0.0), 0.0)
    return hit.astype(jnp.float32), light
