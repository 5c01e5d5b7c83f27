"""Boxes from the maps of the proposal network: peaks of the heatmap, with a soft variant for gradients."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from rpojax.core.pytree import pytree
from rpojax.vision.detector.non_maximum_suppression import suppress_overlapping

STRIDE = 4
"""Side of a cell of the maps [px]."""
SUPPRESSION_IOU = 0.5
SOFT_WINDOW_CELLS = 5
"""Side (odd) of the window around a peak over which the soft box is taken."""
_VOTE_CELLS = 3


@pytree
class ProposalMaps:
    """Outputs of the proposal network for every cell of STRIDE x STRIDE pixels.

    Attributes:
        heatmap: (..., y, x) logit that the centre of a spacecraft is in the cell
        edges: (..., y, x, 4) left, top, right, bottom [px] of its box
    """

    heatmap: Array
    edges: Array


@pytree
class Detections:
    """Boxes by falling score; of missing ones the score is 0.

    Attributes:
        box_px: (..., k, 4) left, top, right, bottom
        score: (..., k) in 0..1
    """

    box_px: Array
    score: Array


def maps_from_channels(raw: Float[Array, "n y x 5"]) -> ProposalMaps:
    """Maps of the network's channels: heatmap logit, and distances of the four edges in asinh."""
    rows, columns = raw.shape[1:3]
    x = (jnp.arange(columns, dtype=jnp.float32) + 0.5) * STRIDE
    y = (jnp.arange(rows, dtype=jnp.float32) + 0.5) * STRIDE
    x, y = jnp.broadcast_to(x[None, :], (rows, columns)), jnp.broadcast_to(y[:, None], (rows, columns))
    center = jnp.stack([x, y, x, y], axis=-1)
    # Like a logarithm for far edges, but negative distances are possible: a cell may lie outside of a small box.
    distance = STRIDE * jnp.sinh(jnp.clip(raw[..., 1:], -4.5, 4.5))
    sign = jnp.array([-1.0, -1.0, 1.0, 1.0], jnp.float32)
    return ProposalMaps(heatmap=raw[..., 0], edges=center[None] + sign[None, None, None, :] * distance)


def decode_boxes(maps: ProposalMaps, count: int) -> Detections:
    """The `count` best boxes of the maps (y, x) of an image: peaks of the heatmap after non-maximum suppression.

    A box is the mean over the peak's cell and its neighbours, weighted by their heat, which has less noise.
    """
    return decode_peaks(maps, count)[0]


def decode_peaks(maps: ProposalMaps, count: int) -> tuple[Detections, Int[Array, " k"]]:
    """The same boxes, and the numbers of the cells of their peaks, row by row."""
    rows, columns = maps.heatmap.shape
    score = jax.nn.sigmoid(maps.heatmap)
    neighbourhood = jax.lax.reduce_window(score, -jnp.inf, jax.lax.max, (3, 3), (1, 1), "SAME")
    peaks = jnp.where(score >= neighbourhood, score, 0.0).reshape(-1)
    candidates = min(3 * count + 2, rows * columns)
    best, place = jax.lax.top_k(peaks, candidates)
    box = jax.vmap(lambda p: _weighted_mean_box(maps, p // columns, p % columns, _VOTE_CELLS))(place)
    kept = suppress_overlapping(box, best, SUPPRESSION_IOU)
    order = jnp.argsort(-kept)[: min(count, candidates)]
    found = Detections(box_px=clip_boxes(box[order], rows * STRIDE, columns * STRIDE), score=kept[order])
    return found, place[order]


def soft_decode_boxes(
    maps: ProposalMaps, peaks: Int[Array, " k"], temperature: float
) -> tuple[Float[Array, "k 4"], Float[Array, " k"]]:
    """Boxes [px] and scores at peaks of the maps (y, x) of an image, both smooth in the maps, for cells of the peaks.

    In place of the box and the score of the hottest cell they are means over the cells of a window around the peak,
    weighted by the softmax of heat over `temperature`; for a low one they are those of `decode_boxes`.
    """
    rows, columns = maps.heatmap.shape

    def decode(peak: Array) -> tuple[Array, Array]:
        y, x, inside = _window_cells(maps, peak // columns, peak % columns, SOFT_WINDOW_CELLS)
        heat = maps.heatmap[y, x]
        weight = jax.nn.softmax(jnp.where(inside, heat / temperature, -jnp.inf))
        boxes = jax.vmap(lambda row, column: _weighted_mean_box(maps, row, column, _VOTE_CELLS))(y, x)
        return jnp.sum(weight[:, None] * boxes, axis=0), jnp.sum(weight * jax.nn.sigmoid(heat))

    boxes, scores = jax.vmap(decode)(peaks)
    return clip_boxes(boxes, rows * STRIDE, columns * STRIDE), scores


def _window(maps: ProposalMaps, row: Array, column: Array, size: int) -> tuple[Array, Array]:
    """Heat (size^2,) and edges (size^2, 4) of the cells around one; outside of the maps the heat is -30."""
    y, x, inside = _window_cells(maps, row, column, size)
    return jnp.where(inside, maps.heatmap[y, x], -30.0), maps.edges[y, x]


def _window_cells(maps: ProposalMaps, row: Array, column: Array, size: int) -> tuple[Array, Array, Array]:
    """Rows and columns (size^2,) of the cells around one, moved into the maps, and whether they lay inside."""
    rows, columns = maps.heatmap.shape
    offset = jnp.arange(size, dtype=row.dtype) - size // 2
    y = jnp.broadcast_to((row + offset)[:, None], (size, size)).reshape(-1)
    x = jnp.broadcast_to((column + offset)[None, :], (size, size)).reshape(-1)
    inside = (y >= 0) & (y < rows) & (x >= 0) & (x < columns)
    return jnp.clip(y, 0, rows - 1), jnp.clip(x, 0, columns - 1), inside


def _weighted_mean_box(maps: ProposalMaps, row: Array, column: Array, size: int) -> Array:
    """Mean of the edges (4,) of the cells around one, weighted by their heat."""
    heat, edges = _window(maps, row, column, size)
    weight = jax.nn.softmax(heat)
    return jnp.sum(weight[:, None] * edges, axis=0)


def clip_boxes(boxes: Float[Array, "n 4"], height: int, width: int) -> Float[Array, "n 4"]:
    """Boxes [px] clipped to an image."""
    high = jnp.array([width, height, width, height], boxes.dtype)
    return jnp.clip(boxes, 0.0, high[None, :])
