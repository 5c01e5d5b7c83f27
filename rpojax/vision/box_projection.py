"""Projection of a hull to its bounding box in the image."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.vision.pinhole import Intrinsics, project


def projected_box(intrinsics: Intrinsics, hull_K: Float[Array, "n 3"]) -> Float[Array, "4"]:
    """Box [px] around the projected hull vertices [m], not clipped to the frame."""
    pixels = project(intrinsics, hull_K)
    return jnp.concatenate([jnp.min(pixels, axis=1), jnp.max(pixels, axis=1)])
