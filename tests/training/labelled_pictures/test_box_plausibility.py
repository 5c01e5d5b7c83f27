"""Boxes in other units than those of COCO are noticed, and right ones are not."""

import json
import re
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from rpojax.errors import Notice
from rpojax.training.labelled_pictures.box_plausibility import (
    BoxForm,
    implausible_boxes,
    outlines_elsewhere,
    pictures_in_both,
)
from rpojax.training.labelled_pictures.dataset_faults import DatasetError
from rpojax.training.labelled_pictures.square_pictures import read_square_picture
from rpojax.training.synthetic_data.detection_dataset import read_dataset
from rpojax.vision.imaging.image_files import read_image

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
        (np.zeros((0, 4)), "no label of a spacecraft: all 1 pictures count as empty"),
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
        (
            BoxForm.CENTRES,
            as_centres(np.array([[0.85, 0.5], [0.4, 0.6]]), np.array([[0.9, 0.1], [0.3, 0.1]])),
            "are width and height exchanged",
        ),
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


@pytest.mark.parametrize(("bits", "notes"), [(16, 0), (14, 1), (13, 1), (12, 1)])
def test_pictures_of_fewer_bits_than_their_file_are_noticed(tmp_path: Path, bits: int, notes: int) -> None:
    folder = write(tmp_path, [[100, 100, 60, 60]])
    cv2.imwrite(str(folder / "images" / "0.png"), np.full((*SIZE[::-1], 3), 2**bits - 1, np.uint16))
    found = notes_of(folder)
    assert len(found) == notes
    assert all(f"no code of 16 bit is above {2**bits - 1}" in note for note in found)


def notes_of(folder: Path) -> tuple[str, ...]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Notice)
        return read_dataset(folder).notes


def test_black_boxes_are_noticed(tmp_path: Path) -> None:
    folder = write(tmp_path, [[100, 100, 60, 60]])
    cv2.imwrite(str(folder / "images" / "0.png"), np.full((*SIZE[::-1], 3), 9, np.uint8))
    assert "1 of 1 boxes show no code above 15" in notes_of(folder)[0]


def test_transparent_parts_are_black_as_in_detection(tmp_path: Path) -> None:
    folder = write(tmp_path, [[100, 100, 60, 60]])
    pixels = np.full((*SIZE[::-1], 4), 255, np.uint8)
    pixels[:, :200, 3] = 0
    cv2.imwrite(str(folder / "images" / "0.png"), pixels)
    square = read_square_picture(folder / "images" / "0.png", 400)
    expected = np.round(255 * read_image(folder / "images" / "0.png"))
    np.testing.assert_array_equal(square.codes[:300], expected)
    assert expected[:, :200].max() == 0.0


def test_a_picture_of_several_frames_is_refused(tmp_path: Path) -> None:
    folder = write(tmp_path, [[100, 100, 60, 60]])
    frames = [Image.new("RGB", SIZE, color) for color in ("black", "gray")]
    frames[0].save(folder / "images" / "0.png", "TIFF", save_all=True, append_images=frames[1:])
    with pytest.raises(DatasetError, match="found 2 frames"):
        read_dataset(folder)


ENTRY = {"file_name": "images/0.png", "width": SIZE[0], "height": SIZE[1]}
NOTE = {"image_id": 0, "category_id": 1, "bbox": [100, 50, 60, 80]}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda mask: mask, None),
        (lambda mask: mask // 255, "masks of 1 of 1 images do not cover.* no code is above 1, where 255"),
        (lambda mask: 255 - mask, "are masks inverted, or boxes elsewhere"),
        (lambda mask: np.roll(mask, 40, axis=1), "are masks inverted, or boxes elsewhere"),
        (lambda mask: 0 * mask, "no code is above 0"),
    ],
)
def test_masks_agree_with_boxes(tmp_path: Path, change: Callable[[np.ndarray], np.ndarray], said: str | None) -> None:
    folder = write(tmp_path, [[100, 50, 60, 80]], images=[{**ENTRY, "id": 0, "mask_file": "mask.png"}])
    mask = np.zeros(SIZE[::-1], np.uint8)
    mask[50:130, 100:160] = 255
    cv2.imwrite(str(folder / "mask.png"), change(mask))
    notes = notes_of(folder)
    assert len(notes) == (said is not None)
    assert said is None or re.search(said, notes[0])


def test_masks_of_some_images_alone_are_told(tmp_path: Path) -> None:
    entries = [{**ENTRY, "id": 0, "mask_file": "mask.png"}, {**ENTRY, "id": 1, "file_name": "images/1.png"}]
    folder = write(tmp_path, [[100, 50, 60, 80]], images=entries)
    cv2.imwrite(str(folder / "images" / "1.png"), np.full((*SIZE[::-1], 3), 70, np.uint8))
    assert [("1 of 2 images have no mask_file" in note) for note in notes_of(folder)] == [True]


def test_one_picture_with_two_labels_is_noticed(tmp_path: Path) -> None:
    entries = [{**ENTRY, "id": 0}, {**ENTRY, "id": 1, "file_name": "copy.png"}]
    folder = write(tmp_path, [[100, 50, 60, 80]], images=entries)
    shutil.copy(folder / "images" / "0.png", folder / "copy.png")
    assert ["1 of 2 pictures show the same as another one" in note for note in notes_of(folder)] == [True]


def test_pictures_of_training_and_validation_are_compared() -> None:
    images = np.random.default_rng(0).integers(0, 255, (6, 8, 8, 3), np.uint8)
    assert pictures_in_both(images[:3], images[3:]) == ()
    assert "2 of 3 pictures for validation" in pictures_in_both(images[:3], images[1:4])[0]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["Sentinel"], None),
        (["earth", "Spacecraft"], "boxes of category 'earth', one of the 2 that are listed, count as spacecraft"),
        (["Spacecraft", "earth"], None),
    ],
)
def test_boxes_of_one_of_several_categories_are_noticed(tmp_path: Path, names: list[str], said: str | None) -> None:
    listed = [{"id": number, "name": name} for number, name in enumerate(names, start=1)]
    notes = notes_of(write(tmp_path, [[100, 50, 60, 80]], categories=listed))
    assert len(notes) == (said is not None)
    assert said is None or said in notes[0]


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
        ({"images": [{**ENTRY, "id": 0}] * 2}, "2 images of id 0"),
        ({"images": [{**ENTRY, "id": i} for i in (0, 1)]}, "found 2 entries of .* with this picture"),
        (
            {
                "images": [
                    {**ENTRY, "id": i, "file_name": name} for i, name in enumerate(("images/0.png", "./images/0.png"))
                ]
            },
            "found 2 entries of .* with this picture",
        ),
        ({"annotations": [{**NOTE, "id": 5}, {**NOTE, "id": 5, "bbox": [9, 9, 30, 30]}]}, "2 annotations of id 5"),
        ({"categories": [{"id": 1, "name": name} for name in "ab"], "annotations": [NOTE]}, "2 categories of id 1"),
        ({"annotations": [{**NOTE, "known_edges": ["false"] * 4}]}, "known_edges"),
        ({"annotations": [{"image_id": 7, "bbox": [1, 1, 9, 9]}]}, "an annotation of image 7, which is not listed"),
        ({"annotations": [{"image_id": "0", "bbox": [1, 1, 9, 9]}]}, "image '0', which is listed, as int and not str"),
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
