"""Boxes in other units than those of COCO are noticed, and right ones are not."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from rpojax.errors import Notice
from rpojax.training.synthetic_data.box_plausibility import implausible_boxes
from rpojax.training.synthetic_data.detection_dataset import DatasetError, read_dataset

RIGHT = np.array(
    [[10.0, 20.0, 40.0, 50.0], [300.0, 180.0, 360.0, 230.0], [5.0, 5.0, 395.0, 290.0], [200.0, 9, 260, 99]]
)
"""Left, top, right, bottom of boxes in pictures of 400 x 300."""
SIZE = (400, 300)


def as_read(left: Any, top: Any, width: Any, height: Any) -> np.ndarray:
    """Edges of boxes from what a file has as left, top, width and height."""
    return np.stack([left, top, left + width, top + height], axis=1)


LEFT, TOP, RIGHT_EDGE, BOTTOM = RIGHT.T
WIDTH, HEIGHT = RIGHT_EDGE - LEFT, BOTTOM - TOP


@pytest.mark.parametrize(
    ("boxes", "expected"),
    [
        (RIGHT, None),
        (RIGHT[:1], None),  # a single small one in a corner
        (np.zeros((0, 4)), None),
        (RIGHT + np.array([-3.0, -3.0, 3.0, 3.0]), None),  # rounded outwards
        (RIGHT / [400.0, 300.0, 400.0, 300.0], "all 4 boxes are below 2 px: are they fractions"),
        (np.full((1, 4), [0.1, 0.1, 0.5, 0.5]), "all 1 boxes are below 2 px"),
        (as_read(LEFT, TOP, RIGHT_EDGE, BOTTOM), "2 of 4 boxes reach beyond their pictures: are they corners"),
        (as_read(LEFT + WIDTH / 2, TOP + HEIGHT / 2, WIDTH, HEIGHT), "are left and top those of the centre"),
        (as_read(TOP, LEFT, HEIGHT, WIDTH), "are x and y, or width and height, exchanged"),
        (RIGHT * 2.56, "were the pictures scaled after labelling"),
        (RIGHT * 0.3, None),  # few
        (np.tile(RIGHT * 0.3, (5, 1)), "all 20 boxes lie in the upper left quarter of their pictures: were these"),
    ],
)
def test_boxes_in_other_units_are_noticed_with_the_likely_cause(boxes: np.ndarray, expected: str | None) -> None:
    found = implausible_boxes([np.asarray(boxes, dtype=float)], [SIZE])
    assert len(found) == (expected is not None)
    assert expected is None or expected in found[0]


@pytest.mark.parametrize("seed", range(5))
def test_random_boxes_inside_of_their_pictures_are_plausible(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = np.sort(rng.uniform(0.0, 256.0, (200, 2, 2)), axis=1)
    boxes = corners.reshape(200, 4)[(corners[:, 1] - corners[:, 0] > 2.0).all(axis=1)]
    assert implausible_boxes(list(boxes[:, None]), [(256, 256)] * len(boxes)) == ()


def write(folder: Path, boxes: list[list[float]], **changed: Any) -> Path:
    (folder / "images").mkdir()
    cv2.imwrite(str(folder / "images" / "0.png"), np.zeros((*SIZE[::-1], 3), np.uint8))
    entries = [{"id": 0, "file_name": "images/0.png", "width": SIZE[0], "height": SIZE[1]}]
    notes = [{"id": i, "image_id": 0, "category_id": 1, "bbox": box} for i, box in enumerate(boxes)]
    content = {"images": entries, "annotations": notes, "categories": [{"id": 1, "name": "craft"}]} | changed
    (folder / "annotations.json").write_text(json.dumps(content))
    return folder


def test_a_data_set_carries_what_is_unlikely_about_it(tmp_path: Path) -> None:
    folder = write(tmp_path, [[0.2, 0.2, 0.5, 0.5]])
    with pytest.warns(Notice, match="fractions of the picture"):
        data = read_dataset(folder)
    assert len(data.notes) == len(data.subset(np.array([0])).notes) == 1


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"images": [{"id": 0, "file_name": "images/0.png", "width": 400, "height": 300}] * 2}, "two images of id 0"),
        ({"annotations": [{"image_id": 7, "bbox": [1, 1, 9, 9]}]}, "an annotation of image 7, which is not listed"),
        ({"annotations": [{"image_id": 0, "bbox": [1, 1, -9, 9]}]}, "bbox"),
        ({"annotations": [{"image_id": 0, "bbox": [1, 1, 9, 9], "category_id": 9}]}, "category 9, which is not listed"),
    ],
)
def test_faults_of_annotations_are_refused_in_one_line(tmp_path: Path, changed: dict[str, Any], reason: str) -> None:
    with pytest.raises(DatasetError, match=reason) as raised:
        read_dataset(write(tmp_path, [], **changed))
    assert "\n" not in str(raised.value)
