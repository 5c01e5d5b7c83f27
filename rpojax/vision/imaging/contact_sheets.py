"""Linear pictures as files that a person looks at: sheets of captioned cells, and films."""

import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import jax.numpy as jnp
import numpy as np

from rpojax.errors import OutputError
from rpojax.vision.radiance_field.render_image import linear_to_srgb

BACKDROP = 0.02
"""Linear radiance behind a target that is shown to a person: sides in shadow stand out from it."""
_GAP = 4
_CAPTION_PX = 18
_PAPER, _INK = 24, (210, 210, 210)
_CODECS = ("vp09", "mp4v")
"""In order of preference: the first plays in browsers too, the second is in every build of OpenCV."""


def over_backdrop(color: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Linear pictures (..., 3) on black with their alpha (...), before the backdrop."""
    return color.astype(np.float32) + BACKDROP * (1.0 - alpha.astype(np.float32)[..., None])


def contact_sheet_png(pictures: np.ndarray, columns: int, captions: Sequence[str] = ()) -> bytes:
    """PNG of linear pictures (n, p, p, 3) in rows of `columns`, each under its caption if there are any."""
    size = pictures.shape[1]
    top = _CAPTION_PX if captions else 0
    rows = -(-len(pictures) // columns)
    width = min(columns, len(pictures)) * (size + _GAP) - _GAP
    sheet = np.full((rows * (size + top + _GAP) - _GAP, width, 3), _PAPER, np.uint8)
    for index, picture in enumerate(pictures):
        row, column = divmod(index, columns)
        y, x = row * (size + top + _GAP), column * (size + _GAP)
        sheet[y + top : y + top + size, x : x + size] = _pixels(picture)
        if captions:
            cv2.putText(sheet, captions[index], (x + 3, y + 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, _INK, 1, cv2.LINE_AA)
    return cv2.imencode(".png", sheet)[1].tobytes()


def video_mp4(pictures: Iterable[np.ndarray], size_px: int, per_second: float = 24.0) -> bytes:
    """MP4 of linear pictures (p, p, 3); raises `OutputError` where this build of OpenCV has no codec for it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        writer = _writer(path, size_px, per_second)
        try:
            for picture in pictures:
                writer.write(_pixels(picture))
        finally:
            writer.release()
        return path.read_bytes()


def _writer(path: Path, size_px: int, per_second: float) -> Any:
    for codec in _CODECS:
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), per_second, (size_px, size_px))
        if writer.isOpened():
            return writer
    raise OutputError(f"film: found no codec in this build of OpenCV, expected one of {', '.join(_CODECS)}")


def _pixels(linear: np.ndarray) -> np.ndarray:
    codes = np.asarray(linear_to_srgb(jnp.asarray(linear, jnp.float32)))
    return np.round(255.0 * codes).astype(np.uint8)[..., ::-1]
