"""Region-of-interest crop: the surroundings of each box, resampled to a square of fixed size."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

CROP_PX = 32
"""Side of a crop."""
_CROP_SCALE = 1.5
_MARGIN_PX = 4.0
"""A crop is the box by `_CROP_SCALE`, and so much more."""


def crop_boxes(
    image: Float[Array, "h w 3"], boxes: Float[Array, "n 4"]
) -> tuple[Float[Array, "n 32 32 4"], Float[Array, "n 4"]]:
    """Crop around each box, stretched to a square, and its edges [px]; differentiable in image and boxes.

    Colours are from -1 to 1, and 0 outside of the image; the fourth channel is 1 inside it.
    """
    height, width = image.shape[:2]
    center = 0.5 * (boxes[:, :2] + boxes[:, 2:])
    side = _CROP_SCALE * jnp.maximum(boxes[:, 2:] - boxes[:, :2], 1.0) + _MARGIN_PX
    low = center - 0.5 * side
    across, in_x = jax.vmap(lambda start, length: _resampling_weights(start, length, width))(low[:, 0], side[:, 0])
    down, in_y = jax.vmap(lambda start, length: _resampling_weights(start, length, height))(low[:, 1], side[:, 1])
    # Rows of all boxes in one matrix product, in the memory order of the image.
    rows = down.reshape(-1, height) @ image.reshape(height, -1)
    color = jnp.einsum("nxj,nyjc->nyxc", across, rows.reshape(-1, CROP_PX, width, 3))
    inside = in_y[:, :, None, None] * in_x[:, None, :, None]
    return jnp.concatenate([2.0 * color - inside, inside], axis=-1), jnp.concatenate([low, low + side], axis=1)


def _resampling_weights(low: Array, side: Array, count: int) -> tuple[Array, Array]:
    """Weights (32, count) of a row of pixels for each place of the crop, and 1 for places within the row.

    A triangle filter: linear interpolation where the crop is finer than the image, and as wide as a place of the crop
    where it is coarser, against aliasing.
    """
    step = side / CROP_PX
    place = low + (jnp.arange(CROP_PX, dtype=jnp.float32) + 0.5) * step
    pixel = jnp.arange(count, dtype=jnp.float32) + 0.5
    wide = jnp.maximum(step, 1.0)
    weight = jnp.maximum(0.0, 1.0 - jnp.abs(pixel[None, :] - place[:, None]) / wide)
    total = jnp.sum(weight, axis=1)
    inside = ((place > 0.0) & (place < count)).astype(jnp.float32)
    return weight / jnp.maximum(total, 1e-3)[:, None] * inside[:, None], inside
