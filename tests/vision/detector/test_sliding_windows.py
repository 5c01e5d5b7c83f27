"""Windows over an image, and boxes of mirrored windows."""

import itertools

import numpy as np
import pytest
from synthetic_rectangles import bright_boxes, image_with_rectangles

from rpojax.vision.detector import sliding_windows


@pytest.mark.parametrize("mirror", list(itertools.product((1, -1), repeat=2)))
def test_mirror_boxes_is_its_own_inverse(mirror: tuple[int, int]) -> None:
    image = image_with_rectangles(sliding_windows.WINDOW_PX, sliding_windows.WINDOW_PX, (20, 30, 60, 44))
    found = bright_boxes(image[:: mirror[1], :: mirror[0]])
    np.testing.assert_array_equal(sliding_windows.mirror_boxes(np.array(found, float), mirror), [[20, 30, 60, 44]])


@pytest.mark.parametrize("length", [128, 129, 200, 208, 209, 1000])
def test_windows_cover_every_pixel_and_overlap(length: int) -> None:
    starts = sliding_windows.window_starts(length)
    assert starts[0] == 0
    assert starts[-1] == length - sliding_windows.WINDOW_PX
    assert all(0 < b - a <= sliding_windows.WINDOW_PX - 40 for a, b in itertools.pairwise(starts))
