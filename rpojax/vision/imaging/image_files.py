"""Image files of a user: JPEG and PNG of any size and depth."""

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpojax.errors import Notice, RpojaxError
from rpojax.untrusted.file_reading import FileError, FileKind, read_bytes

if TYPE_CHECKING:
    from PIL.Image import Image

PIXEL_LIMIT = 50_000_000
"""Most pixels of an image, checked before it is decoded."""
UPRIGHT = 1
"""EXIF orientation of a picture that is shown as it is stored."""
_TURNED = range(2, 9)
"""Orientations of EXIF that turn or mirror a picture; cameras write 0, too."""
_FEWER_BITS = 0.25
"""Largest value of pictures of 14 bit and less in files of 16."""
_EXIF_ORIENTATION = 0x0112
_FORMATS = ("JPEG", "MPO", "PNG")


class ImageFileError(RpojaxError):
    """An image file cannot be used."""


def read_image(path: Path) -> np.ndarray:
    """sRGB codes (h, w, 3) in 0..1 float32, upright as its EXIF orientation says, transparent parts black.

    Raises `ImageFileError` unless the file is a single JPEG or PNG image of at most `PIXEL_LIMIT` pixels. Of a JPEG
    with previews (MPO) the first image is taken. A grey one of 16 bit that has the codes of fewer gives a `Notice`.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            # `PIXEL_LIMIT` replaces the limit of Pillow, which only warns.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(read_bytes(path, FileKind.PICTURE))) as image:
                _check(path, image)
                codes = _codes(image)
                if image.mode.startswith("I") and 0.0 < codes.max() < _FEWER_BITS:
                    note = f"{path}: no code of 16 bit is above {round(65535 * float(codes.max()))}: has it fewer bits?"
                    warnings.warn(f"warning: {note}", Notice, stacklevel=2)
                return codes
    except UnidentifiedImageError:
        raise ImageFileError(f"{path}: found {_other(path)}, expected a JPEG or PNG image") from None
    except FileError as error:
        raise ImageFileError(f"{path}: cannot be read ({error.found}), expected a JPEG or PNG image") from None
    except Image.DecompressionBombError:
        raise ImageFileError(f"{path}: found too many pixels, expected at most {PIXEL_LIMIT}") from None
    except ImageFileError:
        raise
    # Damaged pictures raise errors of many kinds in the decoders.
    except Exception as error:
        reason = " ".join(str(getattr(error, "strerror", None) or error).split())
        raise ImageFileError(f"{path}: cannot be read ({reason}), expected a JPEG or PNG image") from None


def _other(path: Path) -> str:
    return "an empty file" if path.stat().st_size == 0 else "something else"


def check_size(path: Path, content: bytes) -> None:
    """Raises `ImageFileError` if an image of any format has more than `PIXEL_LIMIT` pixels; decodes nothing."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(content)) as image:
                _check_pixels(path, image)
    except ImageFileError:
        raise
    except Exception:
        raise ImageFileError(f"{path}: found no image, expected one of at most {PIXEL_LIMIT} pixels") from None


def orientation(content: bytes) -> int:
    """EXIF orientation of an image, which says how it is to be turned; `UPRIGHT` if it has none or cannot be read."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(content)) as image:
            found = image.getexif().get(_EXIF_ORIENTATION, UPRIGHT)
        return found if found in _TURNED else UPRIGHT
    # Damaged headers raise errors of many kinds.
    except Exception:
        return UPRIGHT


def _check_pixels(path: Path, image: "Image") -> None:
    if image.width * image.height > PIXEL_LIMIT:
        found = f"{image.width} x {image.height} px"
        raise ImageFileError(f"{path}: found {found}, expected at most {PIXEL_LIMIT} pixels")


def _check(path: Path, image: "Image") -> None:
    if image.format not in _FORMATS:
        raise ImageFileError(f"{path}: found {image.format}, expected a JPEG or PNG image")
    _check_pixels(path, image)
    frames = getattr(image, "n_frames", 1)
    if frames > 1 and image.format != "MPO":
        raise ImageFileError(f"{path}: found {frames} frames, expected a single image")


def _codes(image: "Image") -> np.ndarray:
    from PIL import ImageOps

    image = ImageOps.exif_transpose(image)
    if image.mode.startswith("I"):
        grey = np.clip(np.asarray(image).astype(np.float32) / 65535.0, 0.0, 1.0)
        return np.repeat(grey[..., None], 3, axis=2)
    if image.mode in ("LA", "PA", "RGBA", "La", "RGBa") or "transparency" in image.info:
        pixels = np.asarray(image.convert("RGBA")).astype(np.float32) / 255.0
        return pixels[..., :3] * pixels[..., 3:]
    return np.asarray(image.convert("RGB")).astype(np.float32) / np.float32(255.0)
