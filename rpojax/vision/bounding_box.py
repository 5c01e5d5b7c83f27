"""Bounding boxes in an image: size, clipping to the frame."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree


@pytree
class BoundingBox:
    """Bounding box of one frame: what a detector, or a model of one, passes to the flight software.

    Attributes:
        edges: (4,) left, top, right, bottom [px]
        present: () bool, whether there is a box at all
        truncated: () bool, whether an edge of the frame cuts it
    """

    edges: Array
    present: Array
    truncated: Array


def box_center(edges: Float[Array, "4"]) -> Float[Array, "2"]:
    """Centre [px] of a box."""
    return 0.5 * (edges[:2] + edges[2:])


def box_size(edges: Float[Array, "4"]) -> Float[Array, ""]:
    """Geometric mean of width and height [px], at least a tenth of a pixel each."""
    sides = jnp.maximum(edges[2:] - edges[:2], 0.1)
    return jnp.sqrt(sides[0] * sides[1])


def log_aspect_ratio(edges: Float[Array, "4"]) -> Float[Array, ""]:
    """Log of width over height [-], each at least a tenth of a pixel."""
    sides = jnp.log(jnp.maximum(edges[2:] - edges[:2], 0.1))
    return sides[0] - sides[1]


def clip_to_frame(edges: Float[Array, "4"], width_px: int, height_px: int) -> tuple[Float[Array, "4"], Array]:
    """Box clipped to the frame, and whether that changed it."""
    limits = jnp.array([width_px, height_px, width_px, height_px], dtype=edges.dtype)
    clipped = jnp.clip(edges, 0.0, limits)
    return clipped, jnp.any(clipped != edges, axis=0)


def touches_border(
    edges: Float[Array, "4"], low: Float[Array, "4"], high: Float[Array, "4"], margin: Array | float = 1.0
) -> Array:
    """Whether an edge is within a margin [px] of the limits of the image, so that the box may be truncated."""
    return jnp.any((edges[:2] < low[:2] + margin) | (edges[2:] > high[2:] - margin), axis=0)
