"""Square crop around the box of a target, resampled to the size that the landmark network takes."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.vision.detector.region_crop import resampling_weights

CROP_PX = 96
"""Side of a crop."""
CHANNELS = 4
CROP_SCALE = 1.2
MARGIN_PX = 2.0
"""A crop is the longer side of the box by `CROP_SCALE`, and so much more."""
LEAST_SIDE_PX = 8.0
_LEAST_CONTRAST = 0.02
"""Standard deviation of codes below which a crop is not brightened any more."""


@pytree
class CropPlace:
    """Where a square crop is in its picture.

    Attributes:
        low: (2,) left and upper edge [px]
        side: () [px]
    """

    low: Array
    side: Array


def crop_place(box: Float[Array, "4"]) -> CropPlace:
    """Square around a box (left, top, right, bottom) [px], which may be clipped by the frame."""
    center = 0.5 * (box[:2] + box[2:])
    longer = jnp.maximum(jnp.max(box[2:] - box[:2], axis=0), LEAST_SIDE_PX)
    side = CROP_SCALE * longer + MARGIN_PX
    return CropPlace(low=center - 0.5 * side, side=side)


def crop_picture(picture: Float[Array, "h w 3"], place: CropPlace, frame: Float[Array, "4"]) -> Float[Array, "96 96 4"]:
    """Colours of a crop of codes in 0..1, of zero mean and unit deviation within the frame, and 1 within it.

    `frame` are the edges [px] of what the camera has of `picture`; beyond them all channels are 0.
    """
    height, width = picture.shape[:2]
    across, _ = resampling_weights(place.low[0], place.side, width, CROP_PX)
    down, _ = resampling_weights(place.low[1], place.side, height, CROP_PX)
    # As two plain matrix products, with the axis to resample first: XLA is slow at others.
    rows = (down @ picture.reshape(height, -1)).reshape(CROP_PX, width, 3).transpose(1, 0, 2)
    taken = (across @ rows.reshape(width, -1)).reshape(CROP_PX, CROP_PX, 3).transpose(1, 0, 2)
    at = (jnp.arange(CROP_PX, dtype=jnp.float32) + 0.5) * (place.side / CROP_PX)
    in_x, in_y = (
        ((place.low[axis] + at > frame[axis]) & (place.low[axis] + at < frame[axis + 2])).astype(jnp.float32)
        for axis in (0, 1)
    )
    return crop_channels(taken, in_y[:, None] * in_x[None, :])


def crop_channels(taken: Float[Array, "96 96 3"], inside: Float[Array, "96 96"]) -> Float[Array, "96 96 4"]:
    """Channels of `crop_picture` of the resampled codes of a crop, and of 1 where it is within the frame."""
    within = inside[:, :, None]
    count = jnp.maximum(3.0 * jnp.sum(inside), 1.0)
    mean = jnp.sum(within * taken) / count
    deviation = jnp.sqrt(jnp.sum(within * (taken - mean) ** 2) / count)
    scaled = within * (taken - mean) / jnp.maximum(deviation, _LEAST_CONTRAST)
    return jnp.concatenate([scaled, within], axis=2)


def to_crop(points: Float[Array, "n 2"], place: CropPlace) -> Float[Array, "n 2"]:
    """Places in the crop [crop px] of places in the picture [px]."""
    return (points - place.low[None, :]) * (CROP_PX / place.side)


def to_picture(points: Float[Array, "n 2"], place: CropPlace) -> Float[Array, "n 2"]:
    """Places in the picture [px] of places in the crop [crop px]."""
    return place.low[None, :] + points * (place.side / CROP_PX)
