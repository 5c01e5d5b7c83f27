"""Proposal network of the detector: a small fully convolutional network from an image to candidate boxes.

Plain convolutions at falling resolution and a top-down path back to a quarter of it. For every cell there it gives the
probability of a spacecraft's centre (Zhou et al., "Objects as Points", 2019) and the distances of the four edges (Tian
et al., "FCOS", ICCV 2019). Without normalisation and depthwise convolutions, which cost more than they gain on a CPU.
"""

from typing import Any

import jax
import jax.numpy as jnp
from flax import linen
from jaxtyping import Array, Float

from rpojax.vision.detector.box_decoding import Detections, ProposalMaps, decode_boxes, maps_from_channels
from rpojax.vision.detector.convolution import convolution

SIDE_MULTIPLE_PX = 32
"""Sides of images are multiples of this."""
_WIDTHS = (16, 32, 48, 64, 64)
_TOP_DOWN_WIDTH = 48
_HEAD_WIDTH = 32
_PRIOR_LOGIT = -4.6

Params = dict[str, Any]
Images = Float[Array, "n h w 3"]


class ProposalNetwork(linen.Module):
    """Images (n, h, w, 3) in 0..1 to five channels (n, h/4, w/4, 5): heat, and four distances in asinh."""

    @linen.compact
    def __call__(self, images: Array) -> Array:
        levels = []
        values = linen.relu(convolution("stem", _WIDTHS[0], stride=2)(2.0 * images - 1.0))
        for index, width in enumerate(_WIDTHS[1:]):
            values = linen.relu(convolution(f"down{index}", width, stride=2)(values))
            values = values + linen.relu(convolution(f"same{index}", width)(values))
            levels.append(values)
        merged = convolution("top", _TOP_DOWN_WIDTH, size=1)(levels[-1])
        for index in (2, 1, 0):
            side = convolution(f"side{index}", _TOP_DOWN_WIDTH, size=1)(levels[index])
            merged = linen.relu(_upsample(merged) + side)
            if index > 0:
                merged = merged + linen.relu(convolution(f"blend{index}", _TOP_DOWN_WIDTH)(merged))
        values = linen.relu(convolution("head0", _HEAD_WIDTH)(merged))
        values = values + linen.relu(convolution("head1", _HEAD_WIDTH)(values))
        return linen.Conv(
            5, (1, 1), name="out", param_dtype=jnp.float32, bias_init=_bias_init, kernel_init=_small_init
        )(values)


def _bias_init(key: Array, shape: tuple[int, ...], dtype: Any) -> Array:
    """Prior: few cells hold a centre, and edges are about eight pixels away."""
    return jnp.array([_PRIOR_LOGIT, 1.5, 1.5, 1.5, 1.5], dtype)


def _small_init(key: Array, shape: tuple[int, ...], dtype: Any) -> Array:
    return 0.02 * jax.random.normal(key, shape, dtype)


def _upsample(values: Array) -> Array:
    """(n, y, x, c) to (n, 2y, 2x, c) by repetition."""
    n, y, x, c = values.shape
    return jnp.broadcast_to(values[:, :, None, :, None, :], (n, y, 2, x, 2, c)).reshape(n, 2 * y, 2 * x, c)


NETWORK = ProposalNetwork()


def initialize(key: Array) -> Params:
    """Untrained parameters."""
    sample = jnp.zeros((1, SIDE_MULTIPLE_PX, SIDE_MULTIPLE_PX, 3), jnp.float32)
    return dict(NETWORK.init(key, sample)["params"])


def forward(params: Params, images: Images) -> ProposalMaps:
    """Maps (n, h/4, w/4) of images of float32 sRGB codes in 0..1; h and w are multiples of `SIDE_MULTIPLE_PX`."""
    raw = NETWORK.apply({"params": params}, images)
    return maps_from_channels(raw)  # pyright: ignore[reportArgumentType]


def detect(params: Params, images: Images, count: int) -> Detections:
    """The `count` best boxes of each of a batch of images, without refinement."""
    maps = forward(params, images)
    return jax.vmap(lambda heat, edges: decode_boxes(ProposalMaps(heatmap=heat, edges=edges), count))(
        maps.heatmap, maps.edges
    )
