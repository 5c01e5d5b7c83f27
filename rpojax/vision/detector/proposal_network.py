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
from rpojax.vision.detector.convolution import convolution, output_layer

SIDE_MULTIPLE_PX = 32
"""Sides of images are multiples of this."""
_WIDTHS = (16, 32, 48, 64, 64)
_TOP_DOWN_WIDTH = 48
FEATURES = 32
"""Channels of the maps that the refinement network sees."""
_CONTEXT_LEVELS = (2, 3)
"""Levels with further residual layers, which see far around."""
_CONTEXT_SCALE = 0.2
_PRIOR_LOGIT = -4.6

Params = dict[str, Any]
Images = Float[Array, "n h w 3"]


class ProposalNetwork(linen.Module):
    """Images (n, h, w, 3) in 0..1 to three maps (n, h/4, w/4, ...), of 5, 32 and 1 channels.

    The first has heat and four distances in asinh, the second is for the refinement network, and the third is a logit
    that a cell shows a spacecraft, which only a training uses.
    """

    @linen.compact
    def __call__(self, images: Array) -> tuple[Array, Array, Array]:
        levels = []
        values = linen.relu(convolution("stem", _WIDTHS[0], stride=2)(2.0 * images - 1.0))
        for index, width in enumerate(_WIDTHS[1:]):
            values = linen.relu(convolution(f"down{index}", width, stride=2)(values))
            values = values + linen.relu(convolution(f"same{index}", width)(values))
            for number in (0, 1) if index in _CONTEXT_LEVELS else ():
                context = convolution(f"context{index}{number}", width, scale=_CONTEXT_SCALE)(values)
                values = values + linen.relu(context)
            levels.append(values)
        merged = convolution("top", _TOP_DOWN_WIDTH, size=1)(levels[-1])
        for index in (2, 1, 0):
            side = convolution(f"side{index}", _TOP_DOWN_WIDTH, size=1)(levels[index])
            merged = linen.relu(upsample(merged) + side)
            if index > 0:
                merged = merged + linen.relu(convolution(f"blend{index}", _TOP_DOWN_WIDTH)(merged))
        values = linen.relu(convolution("head0", FEATURES)(merged))
        values = values + linen.relu(convolution("head1", FEATURES)(values))
        out = linen.Conv(5, (1, 1), name="out", param_dtype=jnp.float32, bias_init=_bias_init, kernel_init=_small_init)
        return out(values), values, output_layer("out_mask", 1)(values)


def _bias_init(key: Array, shape: tuple[int, ...], dtype: Any) -> Array:
    """Prior: few cells hold a centre, and edges are about eight pixels away."""
    return jnp.array([_PRIOR_LOGIT, 1.5, 1.5, 1.5, 1.5], dtype)


def _small_init(key: Array, shape: tuple[int, ...], dtype: Any) -> Array:
    return 0.02 * jax.random.normal(key, shape, dtype)


def upsample(values: Array) -> Array:
    """(n, y, x, c) to (n, 2y, 2x, c) by repetition."""
    n, y, x, c = values.shape
    return jnp.broadcast_to(values[:, :, None, :, None, :], (n, y, 2, x, 2, c)).reshape(n, 2 * y, 2 * x, c)


NETWORK = ProposalNetwork()
_initialize = jax.jit(NETWORK.init)


def initialize(key: Array) -> Params:
    """Untrained parameters."""
    sample = jnp.zeros((1, SIDE_MULTIPLE_PX, SIDE_MULTIPLE_PX, 3), jnp.float32)
    return dict(_initialize(key, sample)["params"])


def forward(params: Params, images: Images) -> tuple[ProposalMaps, Float[Array, "n y x c"]]:
    """Maps (n, h/4, w/4) of images of float32 sRGB codes in 0..1, and features for the refinement network.

    Sides of images are multiples of `SIDE_MULTIPLE_PX`.
    """
    result: Any = NETWORK.apply({"params": params}, images)
    raw, features, _ = result
    return maps_from_channels(raw), features


def detect(params: Params, images: Images, count: int) -> Detections:
    """The `count` best boxes of each of a batch of images, without refinement."""
    maps, _ = forward(params, images)
    return jax.vmap(lambda heat, edges: decode_boxes(ProposalMaps(heatmap=heat, edges=edges), count))(
        maps.heatmap, maps.edges
    )
