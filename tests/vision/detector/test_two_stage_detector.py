"""Both looks together give boxes; weights come from a file that is checked."""

from collections.abc import Callable
from pathlib import Path

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.detector import proposal_network, two_stage_detector
from rpojax.vision.detector.detector_file import load_detector, packaged_detector_path, save_detector
from rpojax.vision.detector.two_stage_detector import detect, soft_detect
from rpojax.vision.weight_files import WeightsError, read_tensors, write_tensors

Tensors = dict[str, np.ndarray]


def plate(left: int, top: int, right: int, bottom: int) -> np.ndarray:
    """A bright plate on black with a darker stripe, as a spacecraft might look."""
    image = np.zeros((128, 128, 3), np.float32)
    image[top:bottom, left:right] = (0.7, 0.65, 0.5)
    image[top:bottom, (left + right) // 2 : (left + right) // 2 + 2] = 0.2
    return image


@pytest.fixture(scope="module")
def packaged() -> two_stage_detector.DetectorParams:
    return load_detector()[0]


def test_the_second_look_measures_a_box_more_closely(packaged: two_stage_detector.DetectorParams) -> None:
    rng = np.random.default_rng(4)
    find, first_find = (jax.jit(look, static_argnums=2) for look in (detect, proposal_network.detect))
    first_errors, errors = [], []
    for _ in range(24):
        left, top = rng.integers(5, 60, 2)
        true = np.array([left, top, left + rng.integers(14, 60), top + rng.integers(14, 60)])
        image = jnp.asarray(plate(*true))[None]
        found = find(packaged, image, 2)
        assert found.score[0, 0] > found.score[0, 1]
        errors.append(np.abs(np.asarray(found.box_px[0, 0]) - true))
        first_errors.append(np.abs(np.asarray(first_find(packaged["first"], image, 2).box_px[0, 0]) - true))
    assert np.mean(errors) < 0.8 * np.mean(first_errors)
    assert np.median(errors) < 1.0


def test_detections_come_by_falling_score_within_the_picture(packaged: two_stage_detector.DetectorParams) -> None:
    images = jax.random.uniform(jax.random.key(2), (3, 64, 96, 3), jnp.float32)
    found = jax.jit(detect, static_argnums=2)(packaged, images, 4)
    assert found.box_px.shape == (3, 4, 4)
    assert (np.diff(found.score, axis=1) <= 0.0).all()
    assert found.box_px.min() >= 0.0
    assert (np.asarray(found.box_px).reshape(-1, 4).max(axis=0) <= [96, 64, 96, 64]).all()


def test_the_soft_box_has_the_slope_of_finite_differences(packaged: two_stage_detector.DetectorParams) -> None:
    image = jnp.asarray(cv2.GaussianBlur(plate(40, 50, 80, 76), (0, 0), 1.0))
    box, score = soft_detect(packaged, image)
    np.testing.assert_allclose(box, [40, 50, 80, 76], atol=3.0)
    assert score > 0.5
    shift = 0.5 * (jnp.roll(image, -1, axis=1) - jnp.roll(image, 1, axis=1))
    find = jax.jit(lambda i: soft_detect(packaged, i)[0])
    slope = jax.jvp(find, (image,), (shift,))[1]
    step = jnp.float32(0.02)
    difference = (find(image + step * shift) - find(image - step * shift)) / (2.0 * step)
    np.testing.assert_allclose(slope, difference, atol=0.15)
    assert float(jnp.max(jnp.abs(slope))) > 0.3


def test_weights_come_back_from_their_file(tmp_path: Path) -> None:
    params = two_stage_detector.initialize(jax.random.key(3))
    save_detector(params, tmp_path / "weights", {"command": "none"})
    loaded, card = load_detector(tmp_path / "weights")
    assert card == {"command": "none"}
    for a, b in zip(jax.tree.leaves(loaded), jax.tree.leaves(params), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-6)  # half precision


def test_the_packaged_weights_are_small_and_say_how_they_were_made() -> None:
    params, card = load_detector()
    assert packaged_detector_path().stat().st_size <= 2e6
    assert 400_000 <= sum(leaf.size for leaf in jax.tree.leaves(params)) <= 900_000
    assert str(card["command"]).startswith("rpojax detector train")


def test_weights_gone_astray_replace_nothing(tmp_path: Path) -> None:
    params = two_stage_detector.initialize(jax.random.key(0))
    save_detector(params, tmp_path / "weights", {})
    before = (tmp_path / "weights").read_bytes()
    params["second"]["out"]["bias"] = jnp.full(5, 1e6, jnp.float32)  # beyond half precision
    with pytest.raises(WeightsError, match="not finite"):
        save_detector(params, tmp_path / "weights", {})
    assert (tmp_path / "weights").read_bytes() == before


def drop(tensors: Tensors) -> None:
    del tensors["first.stem.kernel"]


def widen(tensors: Tensors) -> None:
    tensors["second.stem.bias"] = np.zeros(7, np.float16)


def retype(tensors: Tensors) -> None:
    tensors["second.stem.bias"] = tensors["second.stem.bias"].astype(np.float64)


def spoil(tensors: Tensors) -> None:
    tensors["second.out.bias"] = np.full_like(tensors["second.out.bias"], np.nan)


def add(tensors: Tensors) -> None:
    tensors["more"] = np.zeros(3, np.float16)


@pytest.mark.parametrize("change", [drop, widen, retype, spoil, add])
def test_a_file_with_other_tensors_is_refused(tmp_path: Path, change: Callable[[Tensors], None]) -> None:
    path = tmp_path / "weights"
    save_detector(two_stage_detector.initialize(jax.random.key(0)), path, {})
    tensors, metadata = read_tensors(path)
    change(tensors)
    write_tensors(path, tensors, metadata)
    with pytest.raises(WeightsError, match="expected") as error:
        load_detector(path)
    assert len(str(error.value).splitlines()) == 1


def test_a_field_is_no_detector_and_rubbish_is_nothing(tmp_path: Path) -> None:
    from rpojax.vision.radiance_field.field_file import packaged_field_path

    with pytest.raises(WeightsError, match="kind"):
        load_detector(packaged_field_path())
    (tmp_path / "rubbish").write_bytes(b"\xff" * 8 + b"{}")
    with pytest.raises(WeightsError, match="cannot be read"):
        load_detector(tmp_path / "rubbish")
