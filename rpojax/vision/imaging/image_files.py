"""Image files of a user, of any size and depth: one reader for detection, training and evaluation."""

import io
import re
import warnings
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from rpojax.errors import Notice, RpojaxError
from rpojax.untrusted.file_reading import FileError, FileKind, read_bytes

PIXEL_LIMIT = 50_000_000
"""Most pixels of an image, checked before it is decoded."""
UPRIGHT = 1
"""EXIF orientation of a picture that is shown as it is stored."""
_TURNED = range(2, 9)
"""Orientations of EXIF that turn or mirror a picture; cameras write 0, too."""
_MOST_BITS = 16
_FEWER_BITS = 14
"""Most bits of a camera whose codes leave those of 16 bits unused."""
_DEEP = re.compile(r"(?:I|LA?|RGB[AX]?);16")
"""Channels of 16 bits, as Pillow names what it is going to decode; of colours it keeps the upper 8 bits."""
_EXIF_ORIENTATION = 0x0112
PHOTOGRAPHS = ("JPEG", "MPO", "PNG")
FORMATS = (*PHOTOGRAPHS, "BMP", "GIF", "PPM", "TIFF", "WEBP")


class ImageFileError(RpojaxError):
    """An image file cannot be used."""


@dataclass(frozen=True)
class ImageFile:
    """An image as its file has it.

    Attributes:
        codes: (h, w, 3) sRGB codes, upright as its EXIF orientation says, transparent parts black: 0..255 uint8, or
            0..1 float32 where 8 bits do not hold them
        orientation: of EXIF
        bits: of a channel that its largest code takes, where the file has 16
    """

    codes: np.ndarray
    orientation: int
    bits: int | None

    @property
    def fractions(self) -> np.ndarray:
        """The codes in 0..1 float32."""
        return _fractions(self.codes)


def read_image(path: Path) -> np.ndarray:
    """sRGB codes (h, w, 3) in 0..1 float32 of a JPEG or PNG image, as `decode_image` has them.

    One of 16 bits that has the codes of fewer gives a `Notice`.
    """
    image = decode_image(path, PHOTOGRAPHS)
    for note in few_bits([image.bits]):
        warnings.warn(f"warning: {path}: {note}", Notice, stacklevel=2)
    return image.fractions


def few_bits(bits: Collection[int | None]) -> tuple[str, ...]:
    """A sentence if files of 16 bits, of which `bits` are what their codes take, together have the codes of fewer."""
    most = max((each for each in bits if each is not None), default=0)
    if not 0 < most <= _FEWER_BITS:
        return ()
    return (f"no code of {_MOST_BITS} bit is above {2**most - 1}: has it fewer bits?",)


def decode_image(path: Path, formats: Collection[str] = FORMATS) -> ImageFile:
    """Image of a file. Of a JPEG with previews (MPO) the first one is taken.

    Raises:
        ImageFileError: it is no single image of a format with at most `PIXEL_LIMIT` pixels.
    """
    expected = "a JPEG or PNG image" if formats == PHOTOGRAPHS else f"an image ({', '.join(formats)})"
    try:
        with warnings.catch_warnings():
            # `PIXEL_LIMIT` replaces the limit of Pillow, which only warns.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(read_bytes(path, FileKind.PICTURE))) as image:
                _check(path, image, formats, expected)
                return _decoded(path, image)
    except UnidentifiedImageError:
        raise ImageFileError(f"{path}: found {_other(path)}, expected {expected}") from None
    except FileError as error:
        raise ImageFileError(f"{path}: cannot be read ({error.found}), expected {expected}") from None
    except Image.DecompressionBombError:
        raise ImageFileError(f"{path}: found too many pixels, expected at most {PIXEL_LIMIT}") from None
    except ImageFileError:
        raise
    # Damaged pictures raise errors of many kinds in the decoders.
    except Exception as error:
        reason = " ".join(str(getattr(error, "strerror", None) or error).split())
        raise ImageFileError(f"{path}: cannot be read ({reason}), expected {expected}") from None


def _other(path: Path) -> str:
    return "an empty file" if path.stat().st_size == 0 else "something else"


def check_size(path: Path, content: bytes) -> None:
    """Raises `ImageFileError` if an image of any format has more than `PIXEL_LIMIT` pixels; decodes nothing."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(content)) as image:
                _check_pixels(path, image)
    except ImageFileError:
        raise
    except Exception:
        raise ImageFileError(f"{path}: found no image, expected one of at most {PIXEL_LIMIT} pixels") from None


def _check_pixels(path: Path, image: Image.Image) -> None:
    if image.width * image.height > PIXEL_LIMIT:
        found = f"{image.width} x {image.height} px"
        raise ImageFileError(f"{path}: found {found}, expected at most {PIXEL_LIMIT} pixels")


def _check(path: Path, image: Image.Image, formats: Collection[str], expected: str) -> None:
    if image.format not in formats:
        raise ImageFileError(f"{path}: found {image.format}, expected {expected}")
    _check_pixels(path, image)
    frames = getattr(image, "n_frames", 1)
    if frames > 1 and image.format != "MPO":
        raise ImageFileError(f"{path}: found {frames} frames, expected a single image")
    if image.mode == "F":
        raise ImageFileError(f"{path}: found floating-point numbers, expected codes of 8 or 16 bit")


def _decoded(path: Path, image: Image.Image) -> ImageFile:
    # What is to be decoded is known until it is, which reading of EXIF may do.
    is_deep = image.mode.startswith("I") or _DEEP.search(str(getattr(image, "tile", ""))) is not None
    turn = image.getexif().get(_EXIF_ORIENTATION, UPRIGHT)
    turn = turn if turn in _TURNED else UPRIGHT
    codes = _codes(path, image if turn == UPRIGHT else ImageOps.exif_transpose(image))
    largest = float(_fractions(codes.max(keepdims=True)).item())
    return ImageFile(codes, turn, round(largest * (2**_MOST_BITS - 1)).bit_length() if is_deep else None)


def _fractions(codes: np.ndarray) -> np.ndarray:
    return codes if codes.dtype == np.float32 else codes.astype(np.float32) / np.float32(255.0)


def _codes(path: Path, image: Image.Image) -> np.ndarray:
    if image.mode.startswith("I"):
        grey = np.asarray(image)
        if not 0 <= int(grey.min()) <= int(grey.max()) < 2**_MOST_BITS:
            raise ImageFileError(f"{path}: found codes {grey.min()} to {grey.max()}, expected at most {_MOST_BITS} bit")
        return np.repeat(grey[..., None].astype(np.float32) / np.float32(2**_MOST_BITS - 1), 3, axis=2)
    if image.mode in ("LA", "PA", "RGBA", "La", "RGBa") or "transparency" in image.info:
        pixels = np.asarray(image.convert("RGBA")).astype(np.float32) / 255.0
        return pixels[..., :3] * pixels[..., 3:]
    return np.asarray(image if image.mode == "RGB" else image.convert("RGB"))
