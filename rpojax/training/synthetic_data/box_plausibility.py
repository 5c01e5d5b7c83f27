"""Boxes of a data set that are formally right and look as if they were meant in another way."""

from collections.abc import Sequence

import numpy as np

_LEAST_SIDE_PX = 2.0
_SLACK = 0.02
"""Share of a picture by which a box may reach beyond it: labels are rounded, and of pictures that were cropped."""
_MANY = 0.05
"""Share of boxes beyond their pictures that is no accident."""
_LEAST_BOXES = 20
"""Fewer boxes may lie in one part of their pictures by chance, such as those of one sequence."""


def implausible_boxes(boxes: Sequence[np.ndarray], sizes: Sequence[tuple[int, int]]) -> tuple[str, ...]:
    """Sentences on what is unlikely about boxes, each with its likely cause; empty for plausible ones.

    Args:
        boxes: for every picture (m, 4) left, top, right, bottom [px]
        sizes: width and height of every picture [px]
    """
    counts = [len(each) for each in boxes]
    total = sum(counts)
    if total == 0:
        return ()
    low, high = np.split(np.concatenate([each for each in boxes if len(each)]), 2, axis=1)
    picture = np.repeat(np.array(sizes, dtype=float), counts, axis=0)
    size, found = high - low, []
    if (size.max(axis=1) < _LEAST_SIDE_PX).all():
        found.append(f"all {total} boxes are below {_LEAST_SIDE_PX:g} px: are they fractions of the picture?")
    beyond = ((high > (1.0 + _SLACK) * picture) | (low < -_SLACK * picture)).any(axis=1)
    if beyond.sum() >= max(1.0, _MANY * total):
        cause = _cause_of_boxes_beyond(low, size, picture)
        found.append(f"{beyond.sum()} of {total} boxes reach beyond their pictures: {cause}")
    elif total >= _LEAST_BOXES and not found and (high < 0.5 * picture).all():
        found.append(
            f"all {total} boxes lie in the upper left quarter of their pictures: were these scaled after labelling?"
        )
    return tuple(found)


def _cause_of_boxes_beyond(low: np.ndarray, size: np.ndarray, picture: np.ndarray) -> str:
    if ((size >= low).all(axis=1) & (size <= (1.0 + _SLACK) * picture).all(axis=1)).all():
        return "are they corners (left, top, right, bottom) instead of left, top, width and height?"
    turned = picture[:, ::-1]
    if ((low + size <= (1.0 + _SLACK) * turned) & (low >= -_SLACK * turned)).all() and (picture != turned).any():
        return "are x and y, or width and height, exchanged?"
    if (low >= 0.5 * size).all() and (low + 0.5 * size <= (1.0 + _SLACK) * picture).all():
        return "are left and top those of the centre of the box?"
    return "were the pictures scaled after labelling?"
