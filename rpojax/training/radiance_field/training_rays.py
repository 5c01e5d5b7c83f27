"""Rays of ray-traced views near the target, as training data of a radiance field."""

from typing import NamedTuple

import cv2
import jax
import jax.numpy as jnp
import numpy as np

from rpojax.training.synthetic_data.ray_traced_views import Views
from rpojax.vision.imaging.srgb import linear_to_srgb
from rpojax.vision.pinhole import pixel_directions

_MARGIN_PX = 3
"""Distance from the silhouette up to which empty pixels are used."""


class TrainingRays(NamedTuple):
    """Camera position (v, 3) [m] and Sun (v, 3) of the views; view (n,), direction (n, 3), code and alpha of the rays.

    Positions and directions are in T, colours (n, 3) are sRGB codes.
    """

    position: jax.Array
    sun: jax.Array
    view: jax.Array
    direction: jax.Array
    color: jax.Array
    alpha: jax.Array


def training_rays(views: Views, first: int, last: int) -> TrainingRays:
    """Rays of the views from `first` up to `last`."""
    size = views.alpha.shape[1]
    disc = np.ones((2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1), np.uint8)
    direction_K = pixel_directions(size, views.field_of_view_deg)
    view, direction, color, alpha = [], [], [], []
    for index in range(first, last):
        near = cv2.dilate((views.alpha[index] > 0.0).astype(np.uint8), disc) > 0
        view.append(np.full(int(near.sum()), index - first, np.int32))
        direction.append((direction_K[near] @ views.rotation[index]).astype(np.float32))
        color.append(views.rgb[index][near])
        alpha.append(views.alpha[index][near].astype(np.float32))
    position, sun = (jnp.asarray(values[first:last], jnp.float32) for values in (views.position, views.sun))
    merged = [jnp.asarray(np.concatenate(values)) for values in (view, direction, color, alpha)]
    codes = linear_to_srgb(merged[2].astype(jnp.float32))
    return TrainingRays(position, sun, merged[0], merged[1], codes, merged[3])


def subsample(rays: TrainingRays, count: int) -> TrainingRays:
    """About `count` of the rays, evenly spaced."""
    step = max(1, len(rays.view) // count)
    return TrainingRays(rays.position, rays.sun, *(values[::step] for values in rays[2:]))
