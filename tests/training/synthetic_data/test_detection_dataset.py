"""Composites have the boxes of what is visible in them; data sets are COCO's, and faulty ones are refused."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rpojax.training.synthetic_data import (
    backdrops,
    detection_dataset,
    earth_textures,
    ray_traced_views,
    spacecraft_sprites,
)
from rpojax.training.synthetic_data.backdrops import paint_backdrop
from rpojax.training.synthetic_data.composites import random_composite
from rpojax.training.synthetic_data.detection_dataset import ANNOTATIONS, DatasetError, read_dataset, write_dataset
from rpojax.training.synthetic_data.earth_textures import EarthTextures
from rpojax.training.synthetic_data.image_sensor import ImageSensor
from rpojax.training.synthetic_data.meshes import procedural_spacecraft
from rpojax.training.synthetic_data.spacecraft_sprites import Sprite
from rpojax.training.synthetic_data.visible_box import visible_box

cv2 = pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def earth() -> EarthTextures:
    """A globe that is red at the longitudes of training and green at those held out, under noise."""
    west, east = (round((longitude + 180.0) / 360.0 * 360) for longitude in earth_textures.TRAINING_LONGITUDES_DEG)
    ground = np.zeros((180, 360, 3), np.uint8)
    ground[:, west:east, 0] = 255
    ground[:, east:, 1] = 255
    noise = np.random.default_rng(0).normal(size=(4, 1024, 1024)).astype(np.float32)
    return EarthTextures((ground,), earth_textures.TRAINING_LONGITUDES_DEG, tuple(noise))


@pytest.fixture(scope="module")
def white() -> Sprite:
    """A white plate of 60 x 30 px."""
    light = np.full((30, 60, 3), 0.8, np.float32)
    return Sprite("plate", light, 0.1 * light, np.ones((30, 60), np.float32))


def covered(left: float, right: float) -> np.ndarray:
    """Share (16, 16) of pixels that a bar covers between two edges, rows 4 to 9."""
    pixel = np.arange(16)
    across = np.clip(np.minimum(pixel + 1, right) - np.maximum(pixel, left), 0.0, 1.0)
    return np.outer((pixel >= 4) & (pixel < 9), across)


def laid(color: np.ndarray, background: np.ndarray, cover: np.ndarray) -> np.ndarray:
    return color * cover[..., None] + background * (1.0 - cover[..., None])


def test_edges_lie_within_the_pixels_that_are_partly_covered() -> None:
    cover = covered(3.25, 11.6)
    black = np.zeros((16, 16, 3))
    box = visible_box(laid(np.full((16, 16, 3), 0.5), black, cover), black, cover)
    np.testing.assert_allclose(box, [3.25, 4.0, 11.6, 9.0])


def test_what_is_as_dark_as_space_is_outside_of_the_box_and_whole_before_a_bright_background() -> None:
    cover = covered(3.0, 12.0)
    color = np.zeros((16, 16, 3))
    color[:, :7] = 0.5
    black, bright = np.zeros((16, 16, 3)), np.full((16, 16, 3), 0.6)
    np.testing.assert_allclose(visible_box(laid(color, black, cover), black, cover), [3.0, 4.0, 7.0, 9.0])
    np.testing.assert_allclose(visible_box(laid(0.0 * color, bright, cover), bright, cover), [3.0, 4.0, 12.0, 9.0])
    assert visible_box(laid(0.0 * color, black, cover), black, cover) is None


def test_what_is_weaker_than_the_noise_is_not_visible() -> None:
    cover = covered(3.0, 12.0)
    black = np.zeros((16, 16, 3))
    faint = laid(np.full((16, 16, 3), 0.006), black, cover)
    assert visible_box(faint, black, cover, ImageSensor(1e5, 10.0)) is not None
    assert visible_box(faint, black, cover, ImageSensor(1e3, 10.0)) is None


def test_the_box_of_a_composite_surrounds_the_bright_pixels(earth: EarthTextures, white: Sprite) -> None:
    seen = 0
    for index in range(120):
        made = random_composite(np.random.default_rng([1, index]), [white], earth, 128)
        assert made.image.dtype == np.uint8
        assert (made.boxes >= 0.0).all()
        assert (made.boxes <= 128.0).all()
        if made.background != "black" or len(made.boxes) != 1:
            continue
        box = made.boxes[0]
        bright = made.image.min(axis=2) > 0.5 * np.quantile(made.image.min(axis=2)[box_slice(box)], 0.9)
        rows, columns = (np.nonzero(bright.any(axis=axis))[0] for axis in (1, 0))
        if bright.sum() > 1.3 * np.prod(box[2:] - box[:2]):
            continue  # a ghost or a hot pixel is as bright
        # The blur moves the half-bright edge by less than a pixel.
        edges = [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
        seen += np.abs(np.array(edges) - box).max() <= 1.5
    assert seen >= 8


def box_slice(box: np.ndarray) -> tuple[slice, slice]:
    left, top, right, bottom = (int(edge) for edge in box)
    return slice(top, bottom + 1), slice(left, right + 1)


def test_a_fifth_of_the_frames_is_empty_and_some_hold_two(earth: EarthTextures, white: Sprite) -> None:
    numbers = [len(random_composite(np.random.default_rng([2, i]), [white], earth, 64).boxes) for i in range(250)]
    # Four standard deviations of 250 draws; a few more are empty because a craft can vanish before its background.
    assert 0.1 <= np.mean(np.array(numbers) == 0) <= 0.34
    assert numbers.count(2) >= 3


@pytest.mark.parametrize("kind", backdrops.BACKDROP_KINDS)
def test_backdrops_are_finite_and_the_same_for_the_same_seed(earth: EarthTextures, kind: str) -> None:
    pictures = [paint_backdrop(np.random.default_rng([3, index]), kind, earth, 48) for index in range(6)]
    assert all(p.shape == (48, 48, 3) and p.dtype == np.float32 and np.isfinite(p).all() for p in pictures)
    assert min(p.min() for p in pictures) >= -1e-6
    assert (kind == "black") == (max(p.max() for p in pictures) == 0.0)
    np.testing.assert_array_equal(pictures[2], paint_backdrop(np.random.default_rng([3, 2]), kind, earth, 48))


def test_training_never_sees_the_longitudes_that_are_held_out(earth: EarthTextures) -> None:
    for index in range(20):
        picture = paint_backdrop(np.random.default_rng([4, index]), "earth", earth, 48)
        # Clouds are grey, the air is a blue that has a little more green than red.
        assert (picture[..., 1] - picture[..., 0]).max() < 0.15
    other = EarthTextures(earth.ground, earth_textures.VALIDATION_LONGITUDES_DEG, earth.noise)
    greens = [paint_backdrop(np.random.default_rng([4, i]), "earth", other, 48) for i in range(20)]
    assert max(float((p[..., 1] - p[..., 0]).max()) for p in greens) > 0.3


def test_spacecraft_have_sizes_of_their_kind_and_every_seed_has_its_own() -> None:
    meshes = [procedural_spacecraft.random_spacecraft([0, 0, index]) for index in range(40)]
    families = {mesh.name.split()[0] for mesh in meshes}
    assert len(families) >= 8
    for mesh in meshes:
        span = mesh.bounds[1] - mesh.bounds[0]
        assert np.isfinite(mesh.vertices).all()
        assert 0.1 <= span.max() <= 15.0
        np.testing.assert_allclose(mesh.bounds.mean(axis=0), 0.0, atol=1e-9)
    again = procedural_spacecraft.random_spacecraft([0, 0, 7])
    np.testing.assert_array_equal(again.vertices, meshes[7].vertices)
    assert len({mesh.vertices.tobytes() for mesh in meshes}) == 40


def test_sprites_are_kept_and_lie_in_their_silhouettes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mitsuba")
    pytest.importorskip("trimesh")
    first = spacecraft_sprites.trace_sprites(tmp_path, 1, 2, 0, held_out=False)
    assert len(first) == 3
    assert sum(sprite.craft == "target" for sprite in first) == 1
    for sprite in first:
        assert sprite.alpha.max() == 1.0
        assert sprite.sunlit[sprite.alpha == 0.0].max(initial=0.0) == 0.0
        # Light from all sides leaves nothing dark but the inside of tubes.
        assert np.mean(sprite.earth_shine[sprite.alpha == 1.0].max(axis=-1) > 0.003) > 0.9
    monkeypatch.setattr(ray_traced_views, "RayTracer", None)
    second = spacecraft_sprites.trace_sprites(tmp_path, 1, 2, 0, held_out=False)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(a.sunlit, b.sunlit, atol=2e-3)  # kept in half precision


# Data sets.


@pytest.fixture
def folder(tmp_path: Path, earth: EarthTextures, white: Sprite) -> Path:
    """A data set of twelve composites."""
    write_dataset(tmp_path / "set", 12, 5, [white], earth)
    return tmp_path / "set"


def test_a_data_set_is_read_by_pycocotools_and_by_us_alike(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    coco = pytest.importorskip("pycocotools.coco").COCO(folder / ANNOTATIONS)
    capsys.readouterr()
    data = read_dataset(folder)
    assert len(coco.imgs) == len(data) == 12
    assert [c["name"] for c in coco.cats.values()] == ["spacecraft"]
    for index, number in enumerate(sorted(coco.imgs)):
        found = [note["bbox"] for note in coco.loadAnns(coco.getAnnIds(imgIds=[number]))]
        expected = np.array([[x, y, x + w, y + h] for x, y, w, h in found]).reshape(-1, 4)
        np.testing.assert_allclose(data.boxes[index], expected, atol=1e-3)
        picture = cv2.imread(str(folder / coco.imgs[number]["file_name"]))
        np.testing.assert_array_equal(data.images[index], picture[..., ::-1])
    summary = detection_dataset.summary(folder)
    assert summary["boxes"] == len(coco.anns)


def test_pictures_of_other_sizes_are_shrunk_with_their_boxes(tmp_path: Path) -> None:
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


def unreadable(folder: Path, content: dict) -> None:
    (folder / ANNOTATIONS).write_text("{")


def missing(folder: Path, content: dict) -> None:
    (folder / ANNOTATIONS).unlink()


def flat(folder: Path, content: dict) -> None:
    content["annotations"][0]["bbox"] = [1, 2, 3, 0]


def short(folder: Path, content: dict) -> None:
    content["annotations"][0]["bbox"] = [1, 2, 3]


def foreign(folder: Path, content: dict) -> None:
    content["annotations"][0]["image_id"] = 99


def without_images(folder: Path, content: dict) -> None:
    content["images"], content["annotations"] = [], []


def other_size(folder: Path, content: dict) -> None:
    content["images"][0]["width"] = 7


def lost_picture(folder: Path, content: dict) -> None:
    (folder / content["images"][0]["file_name"]).unlink()


def broken_picture(folder: Path, content: dict) -> None:
    (folder / content["images"][0]["file_name"]).write_bytes(b"none")


def two_kinds(folder: Path, content: dict) -> None:
    content["annotations"][0]["category_id"] = 7


def crowd(folder: Path, content: dict) -> None:
    content["annotations"][0]["iscrowd"] = 1


def a_list(folder: Path, content: dict) -> None:
    content["images"] = 3


@pytest.mark.parametrize(
    "change",
    [
        unreadable,
        missing,
        flat,
        short,
        foreign,
        without_images,
        other_size,
        lost_picture,
        broken_picture,
        two_kinds,
        crowd,
        a_list,
    ],
)
def test_a_faulty_data_set_is_an_error_of_one_line(folder: Path, change: Callable[[Path, dict], None]) -> None:
    content = json.loads((folder / ANNOTATIONS).read_text())
    change(folder, content)
    if change not in (unreadable, missing):
        (folder / ANNOTATIONS).write_text(json.dumps(content))
    with pytest.raises(DatasetError, match="expected") as error:
        read_dataset(folder)
    assert len(str(error.value).splitlines()) == 1
    assert str(folder) in str(error.value)
