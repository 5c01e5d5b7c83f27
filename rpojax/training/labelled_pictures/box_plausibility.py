"""Boxes of a data set that are formally right and look as if they were meant in another way."""

import hashlib
from collections.abc import Callable, Collection, Sequence
from enum import Enum
from typing import Final

import numpy as np

from rpojax.vision.imaging.image_files import few_bits
from rpojax.vision.intersection_over_union import intersection_over_union

_LEAST_SIDE_PX: Final = 2.0
_SLACK: Final = 0.02
"""Share of a picture by which a box may reach beyond it: labels are rounded, and of pictures that were cropped."""
_MANY: Final = 0.05
"""Share of boxes beyond their pictures that is no accident."""
_MANY_POSES: Final = 0.5
"""The same of spacecraft that are projected, which a picture may show in part."""
_LEAST_CODE: Final = 16
_MOST_DARK: Final = 0.5
"""Share of boxes that may be dark, as in eclipse."""
_LEAST_OVERLAP: Final = 0.5
"""Least intersection over union of a box and that around its outline."""
_LEAST_COVERED: Final = 26
"""Code of a mask from which on a spacecraft covers a pixel by a tenth, and a box surrounds it."""
_LEAST_BOXES: Final = 20
"""Fewer boxes may lie in one part of their pictures by chance, such as those of one sequence."""
_FRACTIONS: Final = "are they fractions of the picture?"
_SCALED: Final = "were the pictures scaled after labelling?"
_SIDES_EXCHANGED: Final = "are width and height exchanged?"
_EXCHANGED: Final = "are x and y, or width and height, exchanged?"


class BoxForm(Enum):
    """What labels say of a box."""

    SIZES = "left, top, width and height [px], as in COCO"
    CORNERS = "left, top, right and bottom [px], as in SPARK"
    CENTRES = "centre, width and height in fractions of the picture, as in YOLO"
    POSES = "the pose of the spacecraft, whose points are projected, as in SPEED+"


def implausible_boxes(
    boxes: Sequence[np.ndarray], sizes: Sequence[tuple[int, int]] | np.ndarray, form: BoxForm = BoxForm.SIZES
) -> tuple[str, ...]:
    """Sentences on unlikely boxes, each with a likely cause; empty for plausible boxes.

    Args:
        boxes: for every picture (m, 4) left, top, right, bottom [px], not cut to the picture
        sizes: width and height of every picture [px]
        form: of the labels from which they are
    """
    counts = [len(image_boxes) for image_boxes in boxes]
    total = sum(counts)
    if total == 0:
        return (f"no label of a spacecraft: all {len(boxes)} pictures count as empty",)
    low, high = np.split(np.concatenate([each for each in boxes if len(each)]), 2, axis=1)
    picture = np.repeat(np.array(sizes, dtype=float), counts, axis=0)
    size, found = high - low, []
    if (size.max(axis=1) < _LEAST_SIDE_PX).all():
        found.append(f"all {total} boxes are below {_LEAST_SIDE_PX:g} px: {_SMALL[form]}")
    beyond = ((high > (1.0 + _SLACK) * picture) | (low < -_SLACK * picture)).any(axis=1)
    if beyond.sum() >= max(1.0, (_MANY_POSES if form is BoxForm.POSES else _MANY) * total):
        cause = _CAUSES[form](low, size, picture)
        found.append(f"{beyond.sum()} of {total} boxes reach beyond their pictures: {cause}")
    elif total >= _LEAST_BOXES and not found and (high < 0.5 * picture).all():
        found.append(
            f"all {total} boxes lie in the upper left quarter of their pictures: were these scaled after labelling?"
        )
    twice = sum(len(each) - len(np.unique(each, axis=0)) for each in boxes if len(each))
    if twice:
        found.append(f"{twice} of {total} boxes stand once more in the same picture: are labels merged twice?")
    return tuple(found)


def outlines_elsewhere(boxes: np.ndarray, outlines: np.ndarray) -> tuple[str, ...]:
    """A sentence if boxes (n, 4) differ from the boxes `outlines` (n, 4) around their outlines."""
    number = _number_apart(boxes, outlines)
    said = f"{number} of {len(boxes)} boxes are not around their outlines (segmentation): which of them is right?"
    return (said,) if number else ()


def masks_elsewhere(boxes: Sequence[np.ndarray], masks: np.ndarray, sizes: np.ndarray) -> tuple[str, ...]:
    """A sentence if masks (n, p, p) of codes 0 to 255 do not cover what boxes (m, 4) [px] of each image surround.

    `sizes` (n, 2) are width and height of the part of each square that is picture [px].
    """
    around = np.zeros((len(masks), 2, 4))
    for index, (found, mask, size) in enumerate(zip(boxes, masks, sizes, strict=True)):
        rows, columns = np.nonzero(mask >= _LEAST_COVERED)
        if len(found):
            around[index, 0] = np.clip([*found[:, :2].min(axis=0), *found[:, 2:].max(axis=0)], 0, np.tile(size, 2))
        if len(rows):
            around[index, 1] = columns.min(), rows.min(), columns.max() + 1, rows.max() + 1
    number = _number_apart(around[:, 0], around[:, 1])
    cause = "are masks inverted, or boxes elsewhere?"
    if masks.max(initial=0) < _LEAST_COVERED:
        cause = f"no code is above {masks.max(initial=0)}, where 255 is a pixel that a spacecraft covers"
    return (f"masks of {number} of {len(masks)} images do not cover what their boxes surround: {cause}",) * (number > 0)


def _number_apart(boxes: np.ndarray, others: np.ndarray) -> int:
    """How many of boxes (n, 4) [px] are not like the others (n, 4); 0 if that are few."""
    differ = np.abs(boxes - others).max(axis=1, initial=0.0) > _LEAST_SIDE_PX
    apart = differ & (intersection_over_union(boxes, others) < _LEAST_OVERLAP)
    return int(apart.sum()) if apart.sum() >= max(1.0, _MANY * len(boxes)) else 0


def implausible_pictures(
    images: np.ndarray, boxes: Sequence[np.ndarray], bits: Collection[int | None]
) -> tuple[str, ...]:
    """Sentences on what is unlikely about images (n, p, p, 3) of 8 bit with boxes (m, 4) [px].

    `bits` are those that the largest code of each file with 16 takes.
    """
    return (*(few_bits(bits) or _dark_boxes(images, boxes)), *_labelled_otherwise(images, boxes))


def _labelled_otherwise(images: np.ndarray, boxes: Sequence[np.ndarray]) -> tuple[str, ...]:
    """A sentence if the same image stands more than once in a data set, with other boxes."""
    first: dict[bytes, np.ndarray] = {}
    number = 0
    for image, found in zip(images, boxes, strict=True):
        ordered = np.unique(found, axis=0)
        # All pictures in darkness are alike.
        number += bool(image.any()) and not np.array_equal(first.setdefault(_digest(image), ordered), ordered)
    return (f"{number} of {len(images)} pictures show the same as another one and have other boxes",) * (number > 0)


def pictures_in_both(training: np.ndarray, validation: np.ndarray) -> tuple[str, ...]:
    """A sentence if images (m, p, p, 3) of 8 bit for validation are among those (n, p, p, 3) of the training."""
    known = set(map(_digest, training))
    number = sum(bool(image.any()) and _digest(image) in known for image in validation)
    return (f"{number} of {len(validation)} pictures for validation are among those of the training",) * (number > 0)


def _digest(image: np.ndarray) -> bytes:
    return hashlib.sha256(image.tobytes()).digest()


def _dark_boxes(images: np.ndarray, boxes: Sequence[np.ndarray]) -> tuple[str, ...]:
    """A sentence if images (n, p, p, 3) of 8 bit show nothing in most of their boxes (m, 4) [px]."""
    brightest = []
    for image, found in zip(images, boxes, strict=True):
        for left, top, right, bottom in np.asarray(found, dtype=float):
            rows = slice(max(0, int(top)), max(1, int(np.ceil(bottom))))
            part = image[rows, max(0, int(left)) : max(1, int(np.ceil(right)))]
            brightest.append(int(part.max(initial=0)))
    dark = sum(code < _LEAST_CODE for code in brightest)
    if dark <= _MOST_DARK * len(brightest):
        return ()
    return (
        f"{dark} of {len(brightest)} boxes show no code above {_LEAST_CODE - 1} of 255: "
        "are pictures linear, or boxes those of others?",
    )


_SMALL: Final = {
    BoxForm.SIZES: _FRACTIONS,
    BoxForm.CORNERS: _FRACTIONS,
    BoxForm.CENTRES: "were they divided by the sides of the picture twice?",
    BoxForm.POSES: "is the position in metres, and the camera's matrix in pixels?",
}
"""Likely causes of boxes below a pixel or two."""


def _of_sizes(low: np.ndarray, size: np.ndarray, picture: np.ndarray) -> str:
    if ((size >= low).all(axis=1) & (size <= (1.0 + _SLACK) * picture).all(axis=1)).all():
        return "are they corners (left, top, right, bottom) instead of left, top, width and height?"
    if _fit_turned(low, size, picture):
        return _EXCHANGED
    if (low >= 0.5 * size).all() and (low + 0.5 * size <= (1.0 + _SLACK) * picture).all():
        return "are left and top those of the centre of the box?"
    if (low + size[:, ::-1] <= (1.0 + _SLACK) * picture).all():
        return _SIDES_EXCHANGED
    return _SCALED


def _of_corners(low: np.ndarray, size: np.ndarray, picture: np.ndarray) -> str:
    return _EXCHANGED if _fit_turned(low, size, picture) else _SCALED


def _of_centres(low: np.ndarray, size: np.ndarray, picture: np.ndarray) -> str:
    first, most = low + 0.5 * size, (1.0 + _SLACK) * picture
    if (first >= 0.0).all() and (size >= first).all() and (size <= most).all():
        return "are they corners (left, top, right, bottom) instead of centre, width and height?"
    if (first >= 0.0).all() and (first + size <= most).all():
        return "are they left, top, width and height instead of centre, width and height?"
    turned = size[:, ::-1] * picture / picture[:, ::-1]
    if (first - 0.5 * turned >= -_SLACK * picture).all() and (first + 0.5 * turned <= most).all():
        return _SIDES_EXCHANGED
    return "are they centre, width and height in fractions of the whole picture?"


def _of_poses(low: np.ndarray, size: np.ndarray, picture: np.ndarray) -> str:
    del low, size, picture
    return "is the camera that of these pictures?"


def _fit_turned(low: np.ndarray, size: np.ndarray, picture: np.ndarray) -> bool:
    """Whether boxes lie within pictures whose sides are exchanged."""
    turned = picture[:, ::-1]
    inside = (low + size <= (1.0 + _SLACK) * turned) & (low >= -_SLACK * turned)
    return bool(inside.all() and (picture != turned).any())


_CAUSES: Final[dict[BoxForm, Callable[[np.ndarray, np.ndarray, np.ndarray], str]]] = {
    BoxForm.SIZES: _of_sizes,
    BoxForm.CORNERS: _of_corners,
    BoxForm.CENTRES: _of_centres,
    BoxForm.POSES: _of_poses,
}
