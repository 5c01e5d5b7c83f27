"""Greedy non-maximum suppression of boxes (left, top, right, bottom)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.vision.intersection_over_union import pairwise_iou


def suppress_overlapping(boxes: Float[Array, "n 4"], scores: Float[Array, " n"], max_iou: float) -> Float[Array, " n"]:
    """Scores, given by falling value, with 0 for boxes whose IoU with an earlier kept one is above `max_iou`."""
    count = boxes.shape[0]
    overlapping = pairwise_iou(boxes, boxes) > max_iou

    def step(kept: Array, index: Array) -> tuple[Array, None]:
        earlier = jnp.arange(count, dtype=index.dtype) < index
        suppressed = jnp.any(overlapping[index] & (kept > 0.0) & earlier)
        return kept.at[index].set(jnp.where(suppressed, 0.0, kept[index])), None

    kept, _ = jax.lax.scan(step, scores, jnp.arange(count, dtype=jnp.int32))
    return kept
