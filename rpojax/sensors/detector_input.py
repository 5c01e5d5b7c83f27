"""Input of the detector: the image of a commanded window of the camera's frame."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.vision.detector.proposal_network import SIDE_MULTIPLE_PX
from rpojax.vision.imaging.image_formation import ImageWindow, image_window
from rpojax.vision.pinhole import Intrinsics

MAX_INPUT_PX = 128
"""Side of the image that the detector gets from larger frames [px]: that of experiments/detector, with its speed."""


def input_side(width_px: int, height_px: int) -> int:
    """Side [px] of the image that the detector gets: the frame, or for large frames a window of it."""
    return min(-(-max(width_px, height_px) // SIDE_MULTIPLE_PX) * SIDE_MULTIPLE_PX, MAX_INPUT_PX)


def window_at(intrinsics: Intrinsics, corner_px: Float[Array, "2"], binning: Float[Array, ""]) -> ImageWindow:
    """Window at a corner of the frame, with intrinsics in single precision."""
    single = Intrinsics(
        focal_px=intrinsics.focal_px.astype(jnp.float32),
        center_px=intrinsics.center_px.astype(jnp.float32),
        distortion=None if intrinsics.distortion is None else intrinsics.distortion.astype(jnp.float32),
    )
    return image_window(single, corner_px, binning)
