"""Detector parameters are read back from their files; other files are refused."""

from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.detector import two_stage_detector
from rpojax.vision.detector.detector_file import load_detector, packaged_detector_path, save_detector
from rpojax.vision.weight_files import WeightsError, read_tensors, write_tensors

Tensors = dict[str, np.ndarray]


def test_parameters_are_read_back(tmp_path: Path) -> None:
    params = two_stage_detector.initialize(jax.random.key(3))
    save_detector(params, tmp_path / "weights", {"command": "none"})
    loaded, card = load_detector(tmp_path / "weights")
    assert card == {"command": "none"}
    for a, b in zip(jax.tree.leaves(loaded), jax.tree.leaves(params), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-6)  # half precision


def test_packaged_detector_is_small_and_has_model_card() -> None:
    params, card = load_detector()
    assert packaged_detector_path().stat().st_size <= 2e6
    assert 400_000 <= sum(leaf.size for leaf in jax.tree.leaves(params)) <= 900_000
    assert str(card["command"]).startswith("rpojax detector train")


def test_non_finite_parameters_are_not_written(tmp_path: Path) -> None:
    params = two_stage_detector.initialize(jax.random.key(0))
    save_detector(params, tmp_path / "weights", {})
    before = (tmp_path / "weights").read_bytes()
    params["refinement"]["out"]["bias"] = jnp.full(5, 1e6, jnp.float32)  # beyond half precision
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
def test_file_with_other_tensors_is_refused(tmp_path: Path, change: Callable[[Tensors], None]) -> None:
    path = tmp_path / "weights"
    save_detector(two_stage_detector.initialize(jax.random.key(0)), path, {})
    tensors, metadata = read_tensors(path)
    change(tensors)
    write_tensors(path, tensors, metadata)
    with pytest.raises(WeightsError, match="expected") as error:
        load_detector(path)
    assert len(str(error.value).splitlines()) == 1


def test_file_of_another_layout_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "weights"
    save_detector(two_stage_detector.initialize(jax.random.key(0)), path, {})
    tensors, metadata = read_tensors(path)
    write_tensors(path, tensors, {**metadata, "kind": "rpojax detector 2"})
    with pytest.raises(WeightsError, match="found kind 'rpojax detector 2', expected 'rpojax detector 3'") as error:
        load_detector(path)
    assert len(str(error.value).splitlines()) == 1


def test_field_file_and_damaged_file_are_refused(tmp_path: Path) -> None:
    from rpojax.vision.radiance_field.field_file import packaged_field_path

    with pytest.raises(WeightsError, match="kind"):
        load_detector(packaged_field_path())
    (tmp_path / "damaged").write_bytes(b"\xff" * 8 + b"{}")
    with pytest.raises(WeightsError, match="cannot be read"):
        load_detector(tmp_path / "damaged")
