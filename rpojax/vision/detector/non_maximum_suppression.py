"""Boxes (left, top, right, bottom) that lie over each other."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.vision.bounding_box import overlap


def overlaps(a: Float[Array, "m 4"], b: Float[Array, "n 4"]) -> Float[Array, "m n"]:
    """Intersection over union of every box with every other one."""
    return jax.vmap(lambda one: jax.vmap(lambda other: overlap(one, other))(b))(a)


def suppress(boxes: Float[Array, "n 4"], scores: Float[Array, " n"], most: float) -> Float[Array, " n"]:
    """Scores, falling, of which those are 0 whose box overlaps one that is kept before it by more than `most`."""
    count = boxes.shape[0]
    over = overlaps(boxes, boxes) > most

    def step(kept: Array, index: Array) -> tuple[Array, None]:
        earlier = jnp.arange(count, dtype=index.dtype) < index
        beaten = jnp.any(over[index] & (kept > 0.0) & earlier)
        return kept.at[index].set(jnp.where(beaten, 0.0, kept[index])), None

    kept, _ = jax.lax.scan(step, scores, jnp.arange(count, dtype=jnp.int32))
    return kept
