"""The detector's second look: every box is cut out of the picture, brought to one size and measured again.

The first look names edges from the middle of a spacecraft, which for a large one is far from them. Here all boxes have
the same size, so that an edge is always found at the same place and to the same share of the box (Cai and Vasconcelos,
"Cascade R-CNN", CVPR 2018, with pictures in place of features).
"""

from typing import Any

import jax
import jax.numpy as jnp
from flax import linen
from jaxtyping import Array, Float

from rpojax.vision.detector.convolution import convolution

CROP_PX = 32
"""Side of what is looked at."""
_CROP_SCALE = 1.5
_MARGIN_PX = 4.0
"""A cut is the box by `_AROUND`, and so much more."""
_OFFSET_SCALE = 0.25
_NOMINAL_HALF_SIDE = 0.3

Params = dict[str, Any]


class RefinementNetwork(linen.Module):
    """Cuts (n, 32, 32, 4) to five channels (n, 5): the edges in the cut, and how good the box is (logit)."""

    @linen.compact
    def __call__(self, crops: Array) -> Array:
        values = linen.relu(convolution("stem", 16)(crops))
        for index, width in enumerate((32, 64)):
            values = linen.relu(convolution(f"down{index}", width, stride=2)(values))
            values = values + linen.relu(convolution(f"same{index}", width)(values))
        values = values + linen.relu(convolution("same2", 64)(values))
        values = linen.relu(convolution("whole", 96, size=8, padding=0)(values))
        out = linen.Conv(
            5, (1, 1), name="out", param_dtype=jnp.float32, kernel_init=linen.initializers.normal(0.02, jnp.float32)
        )
        return out(values)[:, 0, 0, :]


NETWORK = RefinementNetwork()


def initialize(key: Array) -> Params:
    """Untrained parameters."""
    return dict(NETWORK.init(key, jnp.zeros((1, CROP_PX, CROP_PX, 4), jnp.float32))["params"])


def refine_boxes(
    params: Params, image: Float[Array, "h w 3"], boxes: Float[Array, "n 4"]
) -> tuple[Float[Array, "n 4"], Float[Array, " n"]]:
    """Boxes [px] measured again in a picture of codes in 0..1, and how good each is (logit)."""
    crops, crop_px = crop_boxes(image, boxes)
    return boxes_from_channels(NETWORK.apply({"params": params}, crops), crop_px)  # pyright: ignore[reportArgumentType]


def boxes_from_channels(
    raw: Float[Array, "n 5"], crop_px: Float[Array, "n 4"]
) -> tuple[Float[Array, "n 4"], Float[Array, " n"]]:
    """Boxes [px] and logits of the network's channels, for cuts at `frame` [px]."""
    base = jnp.array(
        [0.5 - _NOMINAL_HALF_SIDE, 0.5 - _NOMINAL_HALF_SIDE, 0.5 + _NOMINAL_HALF_SIDE, 0.5 + _NOMINAL_HALF_SIDE],
        jnp.float32,
    )
    place = base[None, :] + _OFFSET_SCALE * raw[:, :4]
    corner, side = crop_px[:, :2], crop_px[:, 2:] - crop_px[:, :2]
    return jnp.tile(corner, (1, 2)) + place * jnp.tile(side, (1, 2)), raw[:, 4]


def crop_boxes(
    image: Float[Array, "h w 3"], boxes: Float[Array, "n 4"]
) -> tuple[Float[Array, "n 32 32 4"], Float[Array, "n 4"]]:
    """What lies around each box, stretched to a square, and where that is [px]; differentiable in picture and boxes.

    Colours are from -1 to 1 and 0 beyond the picture; the fourth channel is 1 within it.
    """
    height, width = image.shape[:2]
    middle = 0.5 * (boxes[:, :2] + boxes[:, 2:])
    side = _CROP_SCALE * jnp.maximum(boxes[:, 2:] - boxes[:, :2], 1.0) + _MARGIN_PX
    low = middle - 0.5 * side
    across, in_x = jax.vmap(lambda start, length: _resampling_weights(start, length, width))(low[:, 0], side[:, 0])
    down, in_y = jax.vmap(lambda start, length: _resampling_weights(start, length, height))(low[:, 1], side[:, 1])
    # Rows of all boxes in one product of matrices, as the picture lies in memory.
    rows = down.reshape(-1, height) @ image.reshape(height, -1)
    color = jnp.einsum("nxj,nyjc->nyxc", across, rows.reshape(-1, CROP_PX, width, 3))
    inside = in_y[:, :, None, None] * in_x[:, None, :, None]
    return jnp.concatenate([2.0 * color - inside, inside], axis=-1), jnp.concatenate([low, low + side], axis=1)


def _resampling_weights(low: Array, side: Array, count: int) -> tuple[Array, Array]:
    """Weights (32, count) of a row of pixels in each place of the cut, and 1 for places within the row.

    Triangles: linear between pixels where the cut is finer than they are, and where it is coarser as wide as a place,
    so that nothing is missed.
    """
    step = side / CROP_PX
    place = low + (jnp.arange(CROP_PX, dtype=jnp.float32) + 0.5) * step
    pixel = jnp.arange(count, dtype=jnp.float32) + 0.5
    wide = jnp.maximum(step, 1.0)
    weight = jnp.maximum(0.0, 1.0 - jnp.abs(pixel[None, :] - place[:, None]) / wide)
    total = jnp.sum(weight, axis=1)
    inside = ((place > 0.0) & (place < count)).astype(jnp.float32)
    return weight / jnp.maximum(total, 1e-3)[:, None] * inside[:, None], inside
