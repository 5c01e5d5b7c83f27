"""Pictures of a data set, resized and padded to squares."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from rpojax.training.labelled_pictures.dataset_faults import DatasetError, repeated
from rpojax.untrusted.file_reading import absolute_path
from rpojax.vision.imaging.image_files import UPRIGHT, ImageFileError, decode_image


@dataclasses.dataclass(frozen=True)
class SquarePicture:
    """A picture resized and padded to a square.

    Attributes:
        codes: (p, p, 3) 8 bit sRGB codes
        scale: of lengths in the square over those in the file
        width, height: of the file [px]
        bits: of a channel that its largest code takes, where the file has 16
    """

    codes: np.ndarray
    scale: float
    width: int
    height: int
    bits: int | None


@dataclasses.dataclass(frozen=True)
class SquarePictures:
    """Pictures resized and padded to squares.

    Attributes:
        codes: (n, p, p, 3) 8 bit sRGB codes
        scales: (n,) of lengths in the squares over those in the files
        sizes: (n, 2) width and height of the files [px]
        bits: (n,) of a channel that its largest code takes, where the file has 16
    """

    codes: np.ndarray
    scales: np.ndarray
    sizes: np.ndarray
    bits: tuple[int | None, ...]


def read_pictures(
    paths: Sequence[Path], size_px: int, declared: Sequence[tuple[int, int] | None], labels: Path
) -> SquarePictures:
    """Pictures that `labels` name, as squares of `size_px`, each of the width and height that is declared.

    Raises:
        DatasetError: a file is no such picture, or named twice.
    """
    if found := repeated(map(absolute_path, paths)):
        path, times = found
        raise DatasetError(f"{path}: found {times} entries of {labels} with this picture, expected one for each")
    codes = np.zeros((len(paths), size_px, size_px, 3), np.uint8)
    scales, sizes, bits = np.zeros(len(paths)), np.zeros((len(paths), 2), int), []
    for index, (path, sides) in enumerate(zip(paths, declared, strict=True)):
        picture = read_square_picture(path, size_px, sides)
        codes[index], scales[index], sizes[index] = picture.codes, picture.scale, (picture.width, picture.height)
        bits.append(picture.bits)
    return SquarePictures(codes, scales, sizes, tuple(bits))


def read_square_picture(path: Path, size_px: int, declared: tuple[int, int] | None = None) -> SquarePicture:
    """Picture of a file as a square of `size_px`; with `declared` it must have that width and height.

    Raises:
        DatasetError: it is no such picture.
    """
    try:
        image = decode_image(path)
    except ImageFileError as error:
        raise DatasetError(str(error)) from None
    if image.orientation != UPRIGHT:
        raise DatasetError(
            f"{path}: found a picture that its EXIF orientation {image.orientation} turns, expected one as it is "
            "stored, since boxes may be of either"
        )
    height, width = image.codes.shape[:2]
    if declared is not None and (width, height) != declared:
        raise DatasetError(f"{path}: found {width} x {height} px, expected {declared[0]} x {declared[1]}")
    scale, codes = size_px / max(width, height), image.codes
    if scale != 1.0:
        sides = max(1, round(width * scale)), max(1, round(height * scale))
        codes = cv2.resize(codes, sides, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR)
    square = np.zeros((size_px, size_px, 3), np.uint8)
    square[: codes.shape[0], : codes.shape[1]] = codes if codes.dtype == np.uint8 else np.round(255.0 * codes)
    return SquarePicture(square, scale, width, height, image.bits)
