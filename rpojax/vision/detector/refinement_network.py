"""Refinement network of the detector: each box is cropped, resampled to one size and regressed again.

In the crop all boxes have the same size, so edges are found with the same relative accuracy (Cai and Vasconcelos,
"Cascade R-CNN", CVPR 2018, with image crops in place of features).
"""

from typing import Any

import jax.numpy as jnp
from flax import linen
from jaxtyping import Array, Float

from rpojax.vision.detector.convolution import convolution
from rpojax.vision.detector.region_crop import CROP_PX, crop_boxes

_OFFSET_SCALE = 0.25
_NOMINAL_HALF_SIDE = 0.3

Params = dict[str, Any]


class RefinementNetwork(linen.Module):
    """Crops (n, 32, 32, 4) to five channels (n, 5): the edges in the crop, and the quality logit of the box."""

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
    """Refined boxes [px] in an image of codes in 0..1, and the quality logit of each."""
    crops, crop_px = crop_boxes(image, boxes)
    return boxes_from_channels(NETWORK.apply({"params": params}, crops), crop_px)  # pyright: ignore[reportArgumentType]


def boxes_from_channels(
    raw: Float[Array, "n 5"], crop_px: Float[Array, "n 4"]
) -> tuple[Float[Array, "n 4"], Float[Array, " n"]]:
    """Boxes [px] and quality logits of the network's channels, for crops with edges `crop_px`."""
    base = jnp.array(
        [0.5 - _NOMINAL_HALF_SIDE, 0.5 - _NOMINAL_HALF_SIDE, 0.5 + _NOMINAL_HALF_SIDE, 0.5 + _NOMINAL_HALF_SIDE],
        jnp.float32,
    )
    place = base[None, :] + _OFFSET_SCALE * raw[:, :4]
    corner, side = crop_px[:, :2], crop_px[:, 2:] - crop_px[:, :2]
    return jnp.tile(corner, (1, 2)) + place * jnp.tile(side, (1, 2)), raw[:, 4]
