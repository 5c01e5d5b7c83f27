"""Data sets in COCO format, and errors for invalid ones."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rpojax.training.labelled_pictures.dataset_faults import DatasetError
from rpojax.training.synthetic_data import (
    detection_dataset,
)
from rpojax.training.synthetic_data.detection_dataset import ANNOTATIONS, read_dataset, write_dataset
from rpojax.training.synthetic_data.scenery.earth_views import EarthTextures
from rpojax.training.synthetic_data.spacecraft_sprites import Sprite

cv2 = pytest.importorskip("cv2")


@pytest.fixture
def folder(tmp_path: Path, earth: EarthTextures, white_sprite: Sprite) -> Path:
    """A data set of twelve composites."""
    write_dataset(tmp_path / "set", 12, 5, [white_sprite], earth)
    return tmp_path / "set"


def test_data_set_is_read_as_by_pycocotools(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    coco = pytest.importorskip("pycocotools.coco").COCO(folder / ANNOTATIONS)
    capsys.readouterr()
    data = read_dataset(folder)
    assert len(coco.imgs) == len(data) == 12
    assert [c["name"] for c in coco.cats.values()] == ["spacecraft"]
    for index, number in enumerate(sorted(coco.imgs)):
        found = [note["bbox"] for note in coco.loadAnns(coco.getAnnIds(imgIds=[number]))]
        expected = np.array([[x, y, x + w, y + h] for x, y, w, h in found]).reshape(-1, 4)
        np.testing.assert_allclose(data.boxes[index], expected, atol=1e-3)
        image = cv2.imread(str(folder / coco.imgs[number]["file_name"]))
        np.testing.assert_array_equal(data.images[index], image[..., ::-1])
    summary = detection_dataset.summary(folder)
    assert summary["boxes"] == len(coco.anns)


def test_masks_and_known_edges_are_read_back(folder: Path) -> None:
    data = read_dataset(folder)
    assert data.masks is not None
    for index, boxes in enumerate(data.boxes):
        mask = cv2.imread(str(folder / f"masks/{index:06d}.png"), cv2.IMREAD_GRAYSCALE)
        np.testing.assert_array_equal(data.masks[index], mask)
        assert (mask.max() > 0) == (len(boxes) > 0)
        assert data.known_edges(index).shape == boxes.shape
    notes = json.loads((folder / ANNOTATIONS).read_text())["annotations"]
    assert np.concatenate(data.known).tolist() == [note["known_edges"] for note in notes]
    part = data.subset(np.array([3, 1]))
    assert part.masks is not None
    np.testing.assert_array_equal(part.masks[1], data.masks[1])
    np.testing.assert_array_equal(part.known_edges(0), data.known_edges(3))


def test_images_of_other_sizes_are_resized_with_their_boxes(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.jpg"), np.full((100, 512, 3), 200, np.uint8))
    content = {
        "images": [{"id": "x", "file_name": "a.jpg", "width": 512, "height": 100}],
        "annotations": [{"image_id": "x", "bbox": [40, 20, 80, 40]}],
    }
    (tmp_path / ANNOTATIONS).write_text(json.dumps(content))
    data = read_dataset(tmp_path)
    np.testing.assert_allclose(data.boxes[0], [[10.0, 5.0, 30.0, 15.0]])
    assert data.images[0, 10, 60].tolist() == [200, 200, 200]
    assert data.images[0, 30:].max() == 0
    assert data.backgrounds == ("unknown",)
    assert data.masks is None
    assert data.known_edges(0).all()


def unreadable(folder: Path, content: dict) -> None:
    (folder / ANNOTATIONS).write_text("{")


def missing(folder: Path, content: dict) -> None:
    (folder / ANNOTATIONS).unlink()


def flat(folder: Path, content: dict) -> None:
    content["annotations"][0]["bbox"] = [1, 2, 3, 0]


def short(folder: Path, content: dict) -> None:
    content["annotations"][0]["bbox"] = [1, 2, 3]


def unknown_image(folder: Path, content: dict) -> None:
    content["annotations"][0]["image_id"] = 99


def without_images(folder: Path, content: dict) -> None:
    content["images"], content["annotations"] = [], []


def other_size(folder: Path, content: dict) -> None:
    content["images"][0]["width"] = 7


def missing_image(folder: Path, content: dict) -> None:
    (folder / content["images"][0]["file_name"]).unlink()


def damaged_image(folder: Path, content: dict) -> None:
    (folder / content["images"][0]["file_name"]).write_bytes(b"none")


def two_categories(folder: Path, content: dict) -> None:
    content["annotations"][0]["category_id"] = 7


def crowd(folder: Path, content: dict) -> None:
    content["annotations"][0]["iscrowd"] = 1


def three_flags(folder: Path, content: dict) -> None:
    content["annotations"][0]["known_edges"] = [True, True, True]


def mask_elsewhere(folder: Path, content: dict) -> None:
    content["images"][0]["mask_file"] = "../mask.png"


def images_no_list(folder: Path, content: dict) -> None:
    content["images"] = 3


@pytest.mark.parametrize(
    "change",
    [
        unreadable,
        missing,
        flat,
        short,
        unknown_image,
        without_images,
        other_size,
        missing_image,
        damaged_image,
        two_categories,
        crowd,
        images_no_list,
        three_flags,
        mask_elsewhere,
    ],
)
def test_invalid_data_set_is_an_error_of_one_line(folder: Path, change: Callable[[Path, dict], None]) -> None:
    content = json.loads((folder / ANNOTATIONS).read_text())
    change(folder, content)
    if change not in (unreadable, missing):
        (folder / ANNOTATIONS).write_text(json.dumps(content))
    with pytest.raises(DatasetError, match="expected") as error:
        read_dataset(folder)
    assert len(str(error.value).splitlines()) == 1
    assert str(folder) in str(error.value)
