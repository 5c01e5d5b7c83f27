"""Selection of the window of a large frame that is rendered and passed to the detector."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.vision.detector.proposal_network import SIDE_MULTIPLE_PX
from rpojax.vision.imaging.image_formation import ImageWindow, image_window
from rpojax.vision.pinhole import Intrinsics

Scalar = Float[Array, ""]

MAX_INPUT_PX = 128
"""Side of the image that the detector gets from larger frames."""
TARGET_FRACTION = 0.4
"""Fraction of the window's side that a tracked target is expected to fill."""


def input_side(width_px: int, height_px: int) -> int:
    """Side [px] of the image that the detector gets: the frame, or for large frames a window of it."""
    return min(-(-max(width_px, height_px) // SIDE_MULTIPLE_PX) * SIDE_MULTIPLE_PX, MAX_INPUT_PX)


def choose_window(
    intrinsics: Intrinsics,
    width_px: int,
    height_px: int,
    expected_px: Float[Array, "2"],
    expected_size_px: Scalar,
    tracked: Bool[Array, ""],
) -> ImageWindow:
    """Window around the expected position of a tracked target, else the whole frame, binned to the detector's input."""
    side = input_side(width_px, height_px)
    whole = max(max(width_px, height_px) / side, 1.0)
    binning = jnp.clip(expected_size_px / (TARGET_FRACTION * side), 1.0, whole)
    binning = jnp.where(tracked, binning, whole).astype(jnp.float32)
    limits = jnp.array([width_px, height_px], jnp.float32)
    span = binning * side
    # Where the window is as wide as the frame, it begins where the frame does.
    corner = jnp.clip(expected_px.astype(jnp.float32) - 0.5 * span, 0.0, jnp.maximum(limits - span, 0.0))
    corner = jnp.where(tracked, corner, 0.0)
    return window_at(intrinsics, corner, binning)


def window_at(intrinsics: Intrinsics, corner_px: Float[Array, "2"], binning: Scalar) -> ImageWindow:
    """Window at a corner of the frame, with intrinsics in single precision."""
    single = Intrinsics(
        focal_px=intrinsics.focal_px.astype(jnp.float32), center_px=intrinsics.center_px.astype(jnp.float32)
    )
    return image_window(single, corner_px, binning)
