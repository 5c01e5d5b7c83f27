"""The landmark network: shapes, covariances, derivatives, and its files."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.landmark_network import network
from rpojax.vision.landmark_network.find_landmarks import find_landmarks
from rpojax.vision.landmark_network.landmark_crop import CROP_PX
from rpojax.vision.landmark_network.network_file import PACKAGED_NETWORK, load_network, save_network
from rpojax.vision.surface.landmark_file import landmark_digest, load_landmarks
from rpojax.vision.surface.landmarks import Landmarks
from rpojax.vision.weight_files import WeightsError, packaged_file, read_tensors, write_tensors

_COUNT = 5
_MOST_BYTES = 4 * 2**20


@pytest.fixture(scope="module")
def params() -> network.Params:
    """An untrained network whose outputs differ from landmark to landmark."""
    fresh = network.initialize(jax.random.key(1), _COUNT)
    bias = 3.0 * jax.random.normal(jax.random.key(2), fresh["out_landmark"]["bias"].shape, jnp.float32)
    return {**fresh, "out_landmark": {**fresh["out_landmark"], "bias": bias}}


@pytest.fixture(scope="module")
def landmarks() -> Landmarks:
    return load_landmarks()[0]


def _pictures() -> tuple[jax.Array, jax.Array]:
    pictures = np.random.default_rng(0).random((3, 80, 100, 3)).astype(np.float32)
    boxes = np.array([[10, 10, 60, 50], [0, 0, 100, 80], [70.5, 20.2, 100.0, 75.0]], np.float32)
    return jnp.asarray(pictures), jnp.asarray(boxes)


def test_landmarks_are_found_in_a_batch_as_one_by_one(params: network.Params) -> None:
    pictures, boxes = _pictures()
    found = jax.jit(jax.vmap(find_landmarks, (None, 0, 0)))(params, pictures, boxes)
    assert found.places.shape == (3, _COUNT, 2)
    assert found.covariance.shape == (3, _COUNT, 2, 2)
    assert found.visible_probability.shape == (3, _COUNT)
    alone = jax.jit(find_landmarks)(params, pictures[1], boxes[1])
    np.testing.assert_allclose(found.places[1], alone.places, atol=1e-2)
    np.testing.assert_allclose(found.covariance[1], alone.covariance, rtol=1e-2)


def test_places_and_covariances_scale_with_the_crop(params: network.Params) -> None:
    """A picture of twice the pixels has the same crop, so the same landmarks at twice the places."""
    pictures = []
    for side in (192, 384):
        x, y = np.meshgrid((np.arange(side) + 0.5) / side, (np.arange(side) + 0.5) / side)
        waves = [0.5 + 0.5 * np.sin(a * x + b * y) for a, b in ((21.0, 8.0), (-5.0, 30.0), (14.0, -17.0))]
        pictures.append(jnp.asarray(np.stack(waves, axis=2), jnp.float32))
    margin = 1.0  # the crop is the box by a factor and two more pixels
    box = np.array([40.0, 40.0, 140.0, 140.0])
    boxes = [box, 2.0 * box + np.array([-1, -1, 1, 1]) * margin / 1.2]
    found = [
        find_landmarks(params, picture, jnp.asarray(each, jnp.float32))
        for picture, each in zip(pictures, boxes, strict=True)
    ]
    np.testing.assert_allclose(found[1].places, 2.0 * found[0].places, atol=0.5)
    np.testing.assert_allclose(found[1].covariance, 4.0 * found[0].covariance, rtol=0.05, atol=1.0)


def test_covariances_are_positive_definite_whatever_the_network_gives(params: network.Params) -> None:
    bias = jnp.asarray(np.random.default_rng(3).normal(scale=30.0, size=(_COUNT, 6)).astype(np.float32))
    wild = {**params, "out_landmark": {**params["out_landmark"], "bias": bias}}
    pictures, boxes = _pictures()
    found = find_landmarks(wild, pictures[0], boxes[0])
    covariance = np.asarray(found.covariance, np.float64)
    np.testing.assert_array_equal(covariance, covariance.transpose(0, 2, 1))
    assert np.isfinite(covariance).all()
    # The product of a root of which no diagonal element is below 0.05 px of the crop.
    scale = (1.2 * 50.0 + 2.0) / CROP_PX
    assert (np.sqrt(np.linalg.det(covariance)) > 0.9 * (0.05 * scale) ** 2).all()
    assert (covariance[:, 0, 0] > 0.0).all()


def test_derivatives_to_the_crop_are_those_of_differences(params: network.Params) -> None:
    rng = np.random.default_rng(5)
    double = jax.tree.map(lambda values: values.astype(jnp.float64), params)
    crop, direction = (jnp.asarray(rng.normal(size=(1, CROP_PX, CROP_PX, 4))) for _ in range(2))

    def total(step: jax.Array) -> jax.Array:
        found = network.estimate(double, crop + step * direction)
        return jnp.sum(found.places) + jnp.sum(found.roots) + jnp.sum(found.visible_logit)

    slope = float(jax.grad(total)(jnp.float64(0.0)))
    difference = float(total(jnp.float64(1e-6)) - total(jnp.float64(-1e-6))) / 2e-6
    assert abs(slope) > 1e-3
    assert abs(slope - difference) < 1e-4 * abs(difference)


def test_a_file_gives_back_what_was_written(landmarks: Landmarks, tmp_path: Path) -> None:
    fresh = network.initialize(jax.random.key(0), len(landmarks.positions))
    save_network(fresh, landmarks, tmp_path / "net.safetensors", {"command": "made"})
    found, card = load_network(landmarks, tmp_path / "net.safetensors")
    assert card == {"command": "made"}
    assert (tmp_path / "net.safetensors").stat().st_size < _MOST_BYTES
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(fresh), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-6)


def test_a_network_for_other_landmarks_is_refused(landmarks: Landmarks, tmp_path: Path) -> None:
    path = tmp_path / "net.safetensors"
    save_network(network.initialize(jax.random.key(0), len(landmarks.positions)), landmarks, path, {})
    moved = Landmarks(**{**vars(landmarks), "positions": landmarks.positions + 1e-3})
    swapped = Landmarks(**{**vars(landmarks), "positions": landmarks.positions[::-1]})
    assert len({landmark_digest(each) for each in (landmarks, moved, swapped)}) == 3
    for other in (moved, swapped):
        with pytest.raises(WeightsError, match="network for other landmarks, expected") as caught:
            load_network(other, path)
        assert "\n" not in str(caught.value)


def test_damaged_files_and_others_are_refused(landmarks: Landmarks, tmp_path: Path) -> None:
    path = tmp_path / "net.safetensors"
    with pytest.raises(WeightsError, match="found kind"):
        load_network(landmarks, packaged_file("detector.safetensors"))
    save_network(network.initialize(jax.random.key(0), len(landmarks.positions)), landmarks, path, {})
    tensors, metadata = read_tensors(path)
    name = next(iter(tensors))
    write_tensors(path, {**tensors, name: tensors[name][..., :1]}, metadata)
    with pytest.raises(WeightsError, match="found float16"):
        load_network(landmarks, path)
    write_tensors(path, {**tensors, name: np.full_like(tensors[name], np.nan)}, metadata)
    with pytest.raises(WeightsError, match="not finite"):
        load_network(landmarks, path)
    fresh = network.initialize(jax.random.key(0), len(landmarks.positions))
    with pytest.raises(WeightsError, match="not finite"):
        save_network(jax.tree.map(lambda a: a * 1e9, fresh), landmarks, path, {})


def test_the_packaged_network_is_small_and_belongs_to_the_packaged_landmarks(landmarks: Landmarks) -> None:
    params, card = load_network(landmarks)
    assert packaged_file(PACKAGED_NETWORK).stat().st_size < _MOST_BYTES
    assert params["out_landmark"]["bias"].shape[0] == len(landmarks.positions)
    assert str(card["command"]).startswith("rpojax pose train --out target.pose.safetensors")
