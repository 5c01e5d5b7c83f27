"""Boxes in other units than those of COCO are noticed, and right ones are not."""

import json
import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from rpojax.errors import Notice
from rpojax.training.synthetic_data.box_plausibility import BoxForm, implausible_boxes, outlines_elsewhere
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
        (
            np.tile(RIGHT * 0.3, (5, 1)) + 0.01 * np.arange(20.0)[:, None],
            "all 20 boxes lie in the upper left quarter of their pictures: were these",
        ),
    ],
)
def test_boxes_in_other_units_are_noticed_with_the_likely_cause(boxes: np.ndarray, expected: str | None) -> None:
    found = implausible_boxes([np.asarray(boxes, dtype=float)], [SIZE])
    assert len(found) == (expected is not None)
    assert expected is None or expected in found[0]


def as_centres(first: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Edges [px] of boxes from what a file in YOLO's layout has as centre and size, in fractions."""
    return np.concatenate([first - size / 2, first + size / 2], axis=1) * [*SIZE, *SIZE]


FRACTIONS = RIGHT / [*SIZE, *SIZE]


@pytest.mark.parametrize(
    ("form", "boxes", "expected"),
    [
        (BoxForm.CENTRES, RIGHT, None),
        (
            BoxForm.CENTRES,
            as_centres(FRACTIONS[:, :2], FRACTIONS[:, 2:]),
            "are they corners (left, top, right, bottom)",
        ),
        (
            BoxForm.CENTRES,
            as_centres(FRACTIONS[:, :2], FRACTIONS[:, 2:] - FRACTIONS[:, :2]),
            "are they left, top, width and height instead",
        ),
        (BoxForm.CENTRES, RIGHT / [*SIZE, *SIZE], "were they divided by the sides of the picture twice"),
        (BoxForm.CENTRES, RIGHT * 3.0, "are they centre, width and height in fractions of the whole picture"),
        (BoxForm.CORNERS, FRACTIONS, "are they fractions of the picture"),
        (BoxForm.CORNERS, RIGHT[:, [1, 0, 3, 2]], "are x and y, or width and height, exchanged"),
        (BoxForm.CORNERS, RIGHT * 2.56, "were the pictures scaled after labelling"),
        (BoxForm.POSES, RIGHT / 400.0, "is the position in metres, and the camera's matrix in pixels"),
        (BoxForm.POSES, RIGHT + 200.0, "is the camera that of these pictures"),
        (BoxForm.POSES, RIGHT + np.array([30.0, 0.0, 30.0, 0.0]), None),  # one of four is shown in part
        *((form, RIGHT[[0, 1, 2, 3, 1]], "1 of 5 boxes stand once more in the same picture") for form in BoxForm),
    ],
)
def test_each_form_of_labels_has_causes_of_its_own(form: BoxForm, boxes: np.ndarray, expected: str | None) -> None:
    found = implausible_boxes([boxes], [SIZE], form)
    assert len(found) == (expected is not None)
    assert expected is None or expected in found[0]


def test_boxes_that_are_not_around_their_outlines_are_noticed() -> None:
    assert outlines_elsewhere(RIGHT, RIGHT + np.array([-1.0, 1.0, 2.0, -1.0])) == ()
    assert outlines_elsewhere(RIGHT[:0], RIGHT[:0]) == ()
    small = np.array([[5.0, 5.0, 7.0, 7.0]])
    assert outlines_elsewhere(small, small + 1.5) == ()
    assert "3 of 4 boxes are not around their outlines" in outlines_elsewhere(RIGHT, RIGHT * 0.75)[0]


@pytest.mark.parametrize("seed", range(5))
def test_random_boxes_inside_of_their_pictures_are_plausible(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = np.sort(rng.uniform(0.0, 256.0, (200, 2, 2)), axis=1)
    boxes = corners.reshape(200, 4)[(corners[:, 1] - corners[:, 0] > 2.0).all(axis=1)]
    assert implausible_boxes(list(boxes[:, None]), [(256, 256)] * len(boxes)) == ()


def write(folder: Path, boxes: list[list[float]], **changed: Any) -> Path:
    (folder / "images").mkdir()
    cv2.imwrite(str(folder / "images" / "0.png"), np.full((*SIZE[::-1], 3), 90, np.uint8))
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


def test_outlines_and_boxes_of_a_file_are_compared(tmp_path: Path) -> None:
    outline = [[200.0, 100.0, 260.0, 100.0, 260.0, 180.0], [200.0, 100.0, 230.0, 180.0, 210.0, 170.0]]
    notes = [{"image_id": 0, "category_id": 1, "bbox": [200, 100, 60, 80], "segmentation": outline}]
    (tmp_path / "right").mkdir()
    assert read_dataset(write(tmp_path / "right", [], annotations=notes)).notes == ()
    notes[0] |= {"bbox": [100, 50, 30, 40]}
    (tmp_path / "half").mkdir()
    with pytest.warns(Notice, match="1 of 1 boxes are not around their outlines"):
        read_dataset(write(tmp_path / "half", [], annotations=notes))


@pytest.mark.parametrize(("bits", "is_dark"), [(16, False), (12, True)])
def test_pictures_of_fewer_bits_than_their_file_are_noticed(tmp_path: Path, bits: int, is_dark: bool) -> None:
    folder = write(tmp_path, [[100, 100, 60, 60]])
    cv2.imwrite(str(folder / "images" / "0.png"), np.full((*SIZE[::-1], 3), 2 ** (bits - 1), np.uint16))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Notice)
        notes = read_dataset(folder).notes
    assert [("1 of 1 boxes show no code above 15" in note) for note in notes] == [True] * is_dark


@pytest.mark.parametrize("turn", [3, 6])
def test_a_picture_that_its_exif_turns_is_refused(tmp_path: Path, turn: int) -> None:
    folder = write(tmp_path, [[100, 100, 20, 20]])
    exif = Image.Exif()
    exif[0x0112] = turn
    Image.new("RGB", SIZE, "gray").save(folder / "images" / "0.png", exif=exif)
    with pytest.raises(DatasetError, match=f"EXIF orientation {turn}"):
        read_dataset(folder)
    for upright in (0, 1):
        exif[0x0112] = upright
        Image.new("RGB", SIZE, "gray").save(folder / "images" / "0.png", exif=exif)
        assert len(read_dataset(folder)) == 1


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"images": [{"id": 0, "file_name": "images/0.png", "width": 400, "height": 300}] * 2}, "two images of id 0"),
        (
            {"images": [{"id": i, "file_name": "images/0.png", "width": 400, "height": 300} for i in (0, 1)]},
            "two images of the file images/0.png",
        ),
        ({"annotations": [{"image_id": 7, "bbox": [1, 1, 9, 9]}]}, "an annotation of image 7, which is not listed"),
        ({"annotations": [{"image_id": 0, "bbox": [1, 1, -9, 9]}]}, "bbox"),
        ({"annotations": [{"image_id": 0, "bbox": [1, 1, 9, 9], "bbox_mode": 0}]}, "bbox_mode 0"),
        ({"annotations": [{"image_id": 0, "bbox": [1, 1, 9, 9], "ignore": 1}]}, "a box to ignore in image 0"),
        ({"annotations": [{"image_id": 0, "bbox": [1, 1, 9, 9], "segmentation": [[1, 2, 3]]}]}, "no list of polygons"),
        ({"annotations": [{"image_id": 0, "bbox": [1, 1, 9, 9], "category_id": 9}]}, "category 9, which is not listed"),
    ],
)
def test_faults_of_annotations_are_refused_in_one_line(tmp_path: Path, changed: dict[str, Any], reason: str) -> None:
    with pytest.raises(DatasetError, match=reason) as raised:
        read_dataset(write(tmp_path, [], **changed))
    assert "\n" not in str(raised.value)
