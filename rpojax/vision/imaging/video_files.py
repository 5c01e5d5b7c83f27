"""Linear images as an MP4 video."""

import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rpojax.errors import OutputError
from rpojax.vision.imaging.contact_sheets import bgr_pixels

_CODECS = ("vp09", "mp4v")
"""In order of preference: the first plays in browsers too, the second is in every build of OpenCV."""


def video_mp4(images: Iterable[np.ndarray], size_px: int, per_second: float = 24.0) -> bytes:
    """MP4 of linear images (p, p, 3); raises `OutputError` if this build of OpenCV has no codec for it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        writer = _writer(path, size_px, per_second)
        try:
            for image in images:
                writer.write(bgr_pixels(image))
        finally:
            writer.release()
        return path.read_bytes()


def _writer(path: Path, size_px: int, per_second: float) -> Any:
    for codec in _CODECS:
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), per_second, (size_px, size_px))
        if writer.isOpened():
            return writer
    raise OutputError(f"film: found no codec in this build of OpenCV, expected one of {', '.join(_CODECS)}")
