"""Refinement network of the detector: each box is cropped, resampled to one size, and its edges are found again.

In the crop all boxes have the same size, so edges are found with the same relative accuracy (Cai and Vasconcelos,
"Cascade R-CNN", CVPR 2018, with image crops and maps of the proposal network). The crop goes down to an eighth of its
resolution and back to half of it (Ronneberger et al., "U-Net", 2015); what that finds along each axis gives a
distribution over the places of both edges.
"""

from typing import Any

import jax
import jax.numpy as jnp
from flax import linen
from jaxtyping import Array, Float

from rpojax.vision.detector.box_decoding import STRIDE
from rpojax.vision.detector.convolution import convolution, output_layer
from rpojax.vision.detector.edge_distribution import PLACES, mean_boxes, prior_logits
from rpojax.vision.detector.proposal_network import FEATURES, upsample
from rpojax.vision.detector.region_crop import CHANNELS, CROP_PX, crop_boxes, crop_maps

MASK_CELLS = CROP_PX // 2
"""Cells of the finest level along a side of the crop."""
_MAP_CELLS = CROP_PX // 4
_WIDTHS = (32, 64, 96)
_AXIS_WIDTH = 64
QUALITY_LAYER = "out_quality"
"""Layer whose bias moves all quality logits."""
_SUBDIVISION = PLACES // MASK_CELLS
"""Places of an edge per cell."""

Params = dict[str, Any]


class RefinementNetwork(linen.Module):
    """Crops (n, 48, 48, 5), proposal maps in them (n, 12, 12, c) and prior logits (n, 4, 48) to what is in the crops.

    That are logits (n, 4, 48) of the places of the edges, a quality logit (n,) of the box, and logits (n, 24, 24) that
    a cell shows the spacecraft, which only a training uses. In one the quality, which judges the edges, leaves them as
    they are.
    """

    in_training: bool = True

    @linen.compact
    def __call__(self, crops: Array, maps: Array, prior: Array) -> tuple[Array, Array, Array]:
        fine = linen.relu(convolution("stem", 24, stride=2)(crops))
        fine = linen.relu(convolution("same0", _WIDTHS[0])(fine))
        middle = linen.relu(
            convolution("down1", _WIDTHS[1], stride=2)(fine) + convolution("maps", _WIDTHS[1], size=1)(maps)
        )
        for index in (0, 1):
            middle = middle + linen.relu(convolution(f"middle{index}", _WIDTHS[1])(middle))
        coarse = linen.relu(convolution("down2", _WIDTHS[2], stride=2)(middle))
        for index in (0, 1):
            coarse = coarse + linen.relu(convolution(f"coarse{index}", _WIDTHS[2])(coarse))
        merged = linen.relu(middle + upsample(convolution("up1", _WIDTHS[1], size=1)(coarse)))
        merged = merged + linen.relu(convolution("blend1", _WIDTHS[1])(merged))
        merged = linen.relu(fine + upsample(convolution("up0", _WIDTHS[0], size=1)(merged)))
        merged = merged + linen.relu(convolution("blend0", _WIDTHS[0])(merged))
        logits = self._edges(merged) + prior
        mask = output_layer("out_mask", 1)(merged)[..., 0]
        return logits, self._quality(coarse, logits), mask

    def _edges(self, values: Array) -> Array:
        """Logits (n, 4, 48) of the edges from what the cells (n, y, x, c) have along each axis."""
        along_x = jnp.concatenate([jnp.max(values, axis=1), jnp.mean(values, axis=1)], axis=-1)
        along_y = jnp.concatenate([jnp.max(values, axis=2), jnp.mean(values, axis=2)], axis=-1)
        axes = jnp.stack([along_x, along_y], axis=1)
        axes = linen.relu(_along_axis("axis0")(axes))
        axes = axes + linen.relu(_along_axis("axis1")(axes))
        raw = output_layer("out", 2 * _SUBDIVISION)(axes)
        # Of (n, axis, cell, low or high edge, place) to (n, left, top, right, bottom; place).
        raw = raw.reshape(-1, 2, MASK_CELLS, 2, _SUBDIVISION).transpose(0, 3, 1, 2, 4)
        return raw.reshape(-1, 4, PLACES)

    def _quality(self, coarse: Array, logits: Array) -> Array:
        """Quality logit (n,) from the whole crop and from how sharp the distributions of the edges are."""
        peaks = jnp.max(jax.nn.softmax(logits, axis=-1), axis=-1)
        peaks = jax.lax.stop_gradient(peaks) if self.in_training else peaks
        whole = jnp.concatenate([jnp.max(coarse, axis=(1, 2)), jnp.mean(coarse, axis=(1, 2)), peaks], axis=-1)
        whole = linen.relu(convolution("whole", _AXIS_WIDTH, size=1)(whole[:, None, None, :]))
        return output_layer(QUALITY_LAYER, 1)(whole)[:, 0, 0, 0]


def _along_axis(name: str) -> linen.Conv:
    """Convolution of (n, axis, cell, c) over the cells, the same for both axes."""
    return linen.Conv(
        _AXIS_WIDTH,
        (1, 5),
        padding=((0, 0), (2, 2)),
        name=name,
        param_dtype=jnp.float32,
        kernel_init=linen.initializers.he_normal(),
    )


NETWORK = RefinementNetwork()
_initialize = jax.jit(NETWORK.init)


def initialize(key: Array) -> Params:
    """Untrained parameters."""
    crops = jnp.zeros((1, CROP_PX, CROP_PX, CHANNELS), jnp.float32)
    maps = jnp.zeros((1, _MAP_CELLS, _MAP_CELLS, FEATURES), jnp.float32)
    return dict(_initialize(key, crops, maps, jnp.zeros((1, 4, PLACES), jnp.float32))["params"])


def network_inputs(
    image: Float[Array, "h w 3"], features: Float[Array, "y x c"], boxes: Float[Array, "n 4"]
) -> tuple[Array, Array, Array, Float[Array, "n 4"]]:
    """Crops, maps in them and prior logits, as `RefinementNetwork` takes them, and edges of the crops [px]."""
    crops, crop_px = crop_boxes(image, boxes)
    return crops, crop_maps(features, crop_px, STRIDE, _MAP_CELLS), prior_logits(boxes, crop_px), crop_px


def refine_boxes(
    params: Params, image: Float[Array, "h w 3"], features: Float[Array, "y x c"], boxes: Float[Array, "n 4"]
) -> tuple[Float[Array, "n 4"], Float[Array, " n"]]:
    """Refined boxes [px] in an image of codes in 0..1 with maps of the proposal network; quality logit of each."""
    *inputs, crop_px = network_inputs(image, features, boxes)
    result: Any = RefinementNetwork(in_training=False).apply({"params": params}, *inputs)
    logits, quality, _ = result
    return mean_boxes(logits, crop_px), quality
