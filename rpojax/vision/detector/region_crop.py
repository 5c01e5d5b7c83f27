"""Region-of-interest crop: the surroundings of each box, resampled to a square of fixed size."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

CROP_PX = 48
"""Side of a crop."""
CHANNELS = 5
_CROP_SCALE = 2.0
_MARGIN_PX = 4.0
"""A crop is the box by `_CROP_SCALE`, and so much more."""
_BOX_RAMP = 0.2
"""Width of the soft edge of the box's channel, by half a side of the box."""


def crop_boxes(
    image: Float[Array, "h w 3"], boxes: Float[Array, "n 4"]
) -> tuple[Float[Array, "n 48 48 5"], Float[Array, "n 4"]]:
    """Crop around each box, stretched to a square, and its edges [px]; differentiable in image and boxes.

    Colours are from -1 to 1, and 0 outside of the image; the fourth channel is 1 inside it, the last one in the box.
    """
    center = 0.5 * (boxes[:, :2] + boxes[:, 2:])
    extent = jnp.maximum(boxes[:, 2:] - boxes[:, :2], 1.0)
    side = _CROP_SCALE * extent + _MARGIN_PX
    low = center - 0.5 * side
    color, inside = _resample(image, low, side, CROP_PX)
    offset = jnp.abs((jnp.arange(CROP_PX, dtype=jnp.float32) + 0.5) / CROP_PX - 0.5)
    within = [
        jnp.clip(0.5 + (0.5 - offset[None, :] * (side / extent)[:, axis, None]) / _BOX_RAMP, 0.0, 1.0)
        for axis in (0, 1)
    ]
    in_box = within[1][:, :, None] * within[0][:, None, :]
    channels = [2.0 * color - inside[..., None], inside[..., None], in_box[..., None]]
    return jnp.concatenate(channels, axis=-1), jnp.concatenate([low, low + side], axis=1)


def crop_maps(
    maps: Float[Array, "y x c"], crop_px: Float[Array, "n 4"], stride: int, cells: int
) -> Float[Array, "n p p c"]:
    """Maps with cells of `stride` pixels in crops with edges `crop_px`, resampled to `cells` a side; 0 beyond them."""
    edges = crop_px / stride
    return _resample(maps, edges[:, :2], edges[:, 2:] - edges[:, :2], cells)[0]


def _resample(values: Array, low: Array, side: Array, places: int) -> tuple[Array, Array]:
    """Rectangles of an array (y, x, c) as squares (n, places, places, c), and 1 for places within the array."""
    height, width, channels = values.shape
    across, in_x = jax.vmap(lambda start, length: resampling_weights(start, length, width, places))(
        low[:, 0], side[:, 0]
    )
    down, in_y = jax.vmap(lambda start, length: resampling_weights(start, length, height, places))(
        low[:, 1], side[:, 1]
    )
    # Rows of all boxes in one matrix product, in the memory order of the array.
    rows = down.reshape(-1, height) @ values.reshape(height, -1)
    taken = jnp.einsum("nxj,nyjc->nyxc", across, rows.reshape(-1, places, width, channels))
    return taken, in_y[:, :, None] * in_x[:, None, :]


def resampling_weights(low: Array, side: Array, count: int, places: int) -> tuple[Array, Array]:
    """Weights (places, count) of a row of pixels for each place of the crop, and 1 for places within the row.

    A triangle filter: linear interpolation where the crop is finer than the image, and as wide as a place of the crop
    where it is coarser, against aliasing.
    """
    step = side / places
    place = low + (jnp.arange(places, dtype=jnp.float32) + 0.5) * step
    pixel = jnp.arange(count, dtype=jnp.float32) + 0.5
    wide = jnp.maximum(step, 1.0)
    weight = jnp.maximum(0.0, 1.0 - jnp.abs(pixel[None, :] - place[:, None]) / wide)
    total = jnp.sum(weight, axis=1)
    inside = ((place > 0.0) & (place < count)).astype(jnp.float32)
    return weight / jnp.maximum(total, 1e-3)[:, None] * inside[:, None], inside
