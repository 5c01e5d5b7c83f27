"""Contact sheets: linear images with captions as one PNG."""

from collections.abc import Sequence

import cv2
import jax.numpy as jnp
import numpy as np

from rpojax.vision.imaging.srgb import linear_to_srgb

BACKDROP = 0.02
"""Linear radiance behind a target in images for people, so that sides in shadow stand out."""
_GAP = 4
_CAPTION_PX = 18
_PAPER, _INK = 24, (210, 210, 210)


def over_backdrop(color: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Linear images (..., 3) on black with their alpha (...), over the backdrop."""
    return color.astype(np.float32) + BACKDROP * (1.0 - alpha.astype(np.float32)[..., None])


def contact_sheet_png(images: np.ndarray, columns: int, captions: Sequence[str] = ()) -> bytes:
    """PNG of linear images (n, p, p, 3) in rows of `columns`, each under its caption if there are any."""
    size = images.shape[1]
    top = _CAPTION_PX if captions else 0
    rows = -(-len(images) // columns)
    width = min(columns, len(images)) * (size + _GAP) - _GAP
    sheet = np.full((rows * (size + top + _GAP) - _GAP, width, 3), _PAPER, np.uint8)
    for index, image in enumerate(images):
        row, column = divmod(index, columns)
        y, x = row * (size + top + _GAP), column * (size + _GAP)
        sheet[y + top : y + top + size, x : x + size] = bgr_pixels(image)
        if captions:
            cv2.putText(sheet, captions[index], (x + 3, y + 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, _INK, 1, cv2.LINE_AA)
    return cv2.imencode(".png", sheet)[1].tobytes()


def bgr_pixels(linear: np.ndarray) -> np.ndarray:
    """8 bit sRGB codes of a linear image, channels in the order of OpenCV."""
    codes = np.asarray(linear_to_srgb(jnp.asarray(linear, jnp.float32)))
    return np.round(255.0 * codes).astype(np.uint8)[..., ::-1]
