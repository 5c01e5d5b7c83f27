"""The detector's first look: a small network from a picture to boxes of spacecraft.

Plain convolutions at falling resolution, a way back up to a quarter of it, and for every cell there how likely the
middle of a spacecraft is and how far its four edges are: the head of Zhou et al., "Objects as Points", 2019, with the
distances of Tian et al., "FCOS", ICCV 2019. No normalisation and no depthwise convolutions: on a CPU both cost more
than they bring.
"""

from typing import Any

import jax
import jax.numpy as jnp
from flax import linen
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.vision.detector.convolution import convolution
from rpojax.vision.detector.non_maximum_suppression import suppress_overlapping

STRIDE = 4
SIDE_MULTIPLE_PX = 32
"""Pictures have sides that are multiples of this."""
SUPPRESSION_IOU = 0.5
SOFT_WINDOW_CELLS = 5
"""Cells (odd) around a peak over which the soft box is taken."""
_WIDTHS = (16, 32, 48, 64, 64)
_TOP_DOWN_WIDTH = 48
_HEAD_WIDTH = 32
_PRIOR_LOGIT = -4.6

Params = dict[str, Any]
Images = Float[Array, "n h w 3"]


@pytree
class ProposalMaps:
    """What the network says of every cell of STRIDE x STRIDE pixels.

    Attributes:
        heat: (..., y, x) logit that the middle of a spacecraft is in the cell
        edges: (..., y, x, 4) left, top, right, bottom [px] of its box
    """

    heatmap: Array
    edges: Array


@pytree
class Detections:
    """Boxes by falling score; where there are fewer than asked for, the rest has score 0.

    Attributes:
        box_px: (..., k, 4) left, top, right, bottom
        score: (..., k) in 0..1
    """

    box_px: Array
    score: Array


class ProposalNetwork(linen.Module):
    """Pictures (n, h, w, 3) in 0..1 to five channels (n, h/4, w/4, 5): heat, and four distances in asinh."""

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
    """Few cells hold a middle, and a usual spacecraft has its edges eight pixels away."""
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
    """Maps (n, h/4, w/4) of pictures of float32 sRGB codes in 0..1; h and w are multiples of `MULTIPLE_PX`."""
    raw = NETWORK.apply({"params": params}, images)
    return maps_from_channels(raw)  # pyright: ignore[reportArgumentType]


def maps_from_channels(raw: Float[Array, "n y x 5"]) -> ProposalMaps:
    """Maps of the network's channels."""
    rows, columns = raw.shape[1:3]
    x = (jnp.arange(columns, dtype=jnp.float32) + 0.5) * STRIDE
    y = (jnp.arange(rows, dtype=jnp.float32) + 0.5) * STRIDE
    x, y = jnp.broadcast_to(x[None, :], (rows, columns)), jnp.broadcast_to(y[:, None], (rows, columns))
    middle = jnp.stack([x, y, x, y], axis=-1)
    # Like a logarithm for far edges, but a neighbour of a small box's middle may say that an edge lies behind it.
    distance = STRIDE * jnp.sinh(jnp.clip(raw[..., 1:], -4.5, 4.5))
    sign = jnp.array([-1.0, -1.0, 1.0, 1.0], jnp.float32)
    return ProposalMaps(heatmap=raw[..., 0], edges=middle[None] + sign[None, None, None, :] * distance)


def detect(params: Params, images: Images, count: int) -> Detections:
    """The `count` best boxes of each of a batch of pictures, by this look alone."""
    maps = forward(params, images)
    return jax.vmap(lambda heat, edges: decode_boxes(ProposalMaps(heatmap=heat, edges=edges), count))(
        maps.heatmap, maps.edges
    )


def decode_boxes(maps: ProposalMaps, count: int) -> Detections:
    """The `count` best boxes of one picture's maps (y, x): peaks of heat, less those that overlap a better one.

    A box is the mean of those that the peak's cell and its neighbours name, by their heat: a vote has less noise.
    """
    rows, columns = maps.heatmap.shape
    score = jax.nn.sigmoid(maps.heatmap)
    around = jax.lax.reduce_window(score, -jnp.inf, jax.lax.max, (3, 3), (1, 1), "SAME")
    peaks = jnp.where(score >= around, score, 0.0).reshape(-1)
    candidates = min(3 * count + 2, rows * columns)
    best, place = jax.lax.top_k(peaks, candidates)
    box = jax.vmap(lambda p: _weighted_mean_box(maps, p // columns, p % columns, 3, 1.0))(place)
    kept = suppress_overlapping(box, best, SUPPRESSION_IOU)
    order = jnp.argsort(-kept)[: min(count, candidates)]
    return Detections(box_px=clip_boxes(box[order], rows * STRIDE, columns * STRIDE), score=kept[order])


def soft_decode_box(maps: ProposalMaps) -> tuple[Float[Array, "4"], Float[Array, ""]]:
    """Box and score at the highest peak of one picture's maps (y, x), both differentiable in the maps.

    The box is the mean of a window of cells around the peak by their heat, the score a smooth maximum of the window.
    """
    columns = maps.heatmap.shape[1]
    peak = jnp.argmax(jax.lax.stop_gradient(maps.heatmap))
    row, column = peak // columns, peak % columns
    box = _weighted_mean_box(maps, row, column, SOFT_WINDOW_CELLS, 1.0)
    heat, _ = _window(maps, row, column, SOFT_WINDOW_CELLS)
    return box, jnp.sum(jax.nn.softmax(4.0 * heat) * jax.nn.sigmoid(heat))


def _window(maps: ProposalMaps, row: Array, column: Array, size: int) -> tuple[Array, Array]:
    """Heat (size^2,) and edges (size^2, 4) of the cells around one; cells outside of the maps are cold."""
    rows, columns = maps.heatmap.shape
    offset = jnp.arange(size, dtype=row.dtype) - size // 2
    y = jnp.broadcast_to((row + offset)[:, None], (size, size)).reshape(-1)
    x = jnp.broadcast_to((column + offset)[None, :], (size, size)).reshape(-1)
    inside = (y >= 0) & (y < rows) & (x >= 0) & (x < columns)
    y, x = jnp.clip(y, 0, rows - 1), jnp.clip(x, 0, columns - 1)
    return jnp.where(inside, maps.heatmap[y, x], -30.0), maps.edges[y, x]


def _weighted_mean_box(maps: ProposalMaps, row: Array, column: Array, size: int, sharpness: float) -> Array:
    heat, edges = _window(maps, row, column, size)
    weight = jax.nn.softmax(sharpness * heat)
    return jnp.sum(weight[:, None] * edges, axis=0)


def clip_boxes(boxes: Float[Array, "n 4"], height: int, width: int) -> Float[Array, "n 4"]:
    """Boxes [px] cut to a picture."""
    high = jnp.array([width, height, width, height], jnp.float32)
    return jnp.clip(boxes, 0.0, high[None, :])
