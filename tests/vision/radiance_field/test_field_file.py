"""Radiance fields are read back from their files; other files are refused."""

from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.radiance_field.field_file import load_field, packaged_field_path, save_field
from rpojax.vision.radiance_field.initial_grid import initialize_grid
from rpojax.vision.radiance_field.nerf_field import initialize_nerf
from rpojax.vision.radiance_field.target_field import RadianceField, density
from rpojax.vision.weight_files import WeightsError, read_tensors, write_tensors

Tensors = dict[str, np.ndarray]


def sphere_field(rows: int = 2000) -> RadianceField:
    """Initial field of a sphere of 1 m diameter."""
    points = np.random.default_rng(0).normal(size=(20_000, 3))
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    return initialize_grid(0.5 * normals, normals, jax.random.key(0), rows)


@pytest.mark.parametrize("make", [sphere_field, lambda: initialize_nerf(-np.ones(3), np.ones(3), jax.random.key(0))])
def test_field_is_read_back(tmp_path: Path, make: Callable[[], RadianceField]) -> None:
    field = make()
    save_field(field, tmp_path / "field", {"target": "sphere"})
    loaded, card = load_field(tmp_path / "field")
    assert card == {"target": "sphere"}
    points = jax.random.uniform(jax.random.key(1), (500, 3), jnp.float32, -0.6, 0.6)
    # Half precision has three decimal digits.
    np.testing.assert_allclose(density(loaded, points), density(field, points), rtol=2e-2, atol=0.05)


def test_packaged_field_loads_and_is_small() -> None:
    field, card = load_field()
    assert packaged_field_path().stat().st_size <= 6e6
    assert card["target"] == "target"
    assert np.isfinite(np.asarray(density(field, jnp.zeros((1, 3), jnp.float32)))).all()


def drop(tensors: Tensors) -> None:
    del tensors["matter"]


def widen(tensors: Tensors) -> None:
    tensors["features"] = np.zeros((7, 7), np.float16)


def retype(tensors: Tensors) -> None:
    tensors["low"] = tensors["low"].astype(np.float64)


def spoil(tensors: Tensors) -> None:
    tensors["matter"] = np.full_like(tensors["matter"], np.nan)


def swell(tensors: Tensors) -> None:
    tensors["shape"] = np.array([2_000_000, 2_000_000, 2], np.int32)


def add(tensors: Tensors) -> None:
    tensors["more"] = np.zeros(3, np.float32)


def narrow(tensors: Tensors) -> None:
    tensors["network.0.weight"] = tensors["network.0.weight"][1:]


def lengthen(tensors: Tensors) -> None:
    tensors["network.2.bias"] = np.zeros(4, np.float16)
    tensors["network.2.weight"] = np.zeros((64, 4), np.float16)


@pytest.mark.parametrize("change", [drop, widen, retype, spoil, swell, add, narrow, lengthen])
def test_file_with_other_tensors_is_refused(tmp_path: Path, change: Callable[[Tensors], None]) -> None:
    path = tmp_path / "field"
    save_field(sphere_field(), path, {})
    tensors, metadata = read_tensors(path)
    change(tensors)
    write_tensors(path, tensors, metadata)
    with pytest.raises(WeightsError, match="expected") as error:
        load_field(path)
    assert len(str(error.value).splitlines()) == 1


def test_invalid_card_of_field_is_refused(tmp_path: Path) -> None:
    save_field(sphere_field(), tmp_path / "field", {})
    tensors, metadata = read_tensors(tmp_path / "field")
    write_tensors(tmp_path / "field", tensors, {**metadata, "card": "[1]"})
    with pytest.raises(WeightsError, match="expected an object"):
        load_field(tmp_path / "field")


@pytest.mark.parametrize("content", [b"", b"x" * 100, b"\xff" * 8 + b"{}"])
def test_damaged_field_is_an_error_of_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "field"
    path.write_bytes(content)
    with pytest.raises(WeightsError, match="cannot be read") as error:
        load_field(path)
    assert len(str(error.value).splitlines()) == 1


def test_other_kind_and_missing_file_are_refused(tmp_path: Path) -> None:
    write_tensors(tmp_path / "foreign", {"a": np.zeros(2)}, {"kind": "something else"})
    with pytest.raises(WeightsError, match="kind"):
        load_field(tmp_path / "foreign")
    with pytest.raises(WeightsError, match="cannot be read"):
        load_field(tmp_path / "nowhere")
