"""A field comes back from its file; anything else in a file is an error of one line."""

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


def ball(rows: int = 2000) -> RadianceField:
    """A fresh field round a ball of 1 m diameter."""
    points = np.random.default_rng(0).normal(size=(20_000, 3))
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    return initialize_grid(0.5 * normals, normals, jax.random.key(0), rows)


@pytest.mark.parametrize("make", [ball, lambda: initialize_nerf(-np.ones(3), np.ones(3), jax.random.key(0))])
def test_a_field_comes_back_from_its_file(tmp_path: Path, make: Callable[[], RadianceField]) -> None:
    field = make()
    save_field(field, tmp_path / "field", {"target": "ball"})
    loaded, card = load_field(tmp_path / "field")
    assert card == {"target": "ball"}
    points = jax.random.uniform(jax.random.key(1), (500, 3), jnp.float32, -0.6, 0.6)
    # Half precision has three digits.
    np.testing.assert_allclose(density(loaded, points), density(field, points), rtol=2e-2, atol=0.05)


def test_the_packaged_field_loads_and_is_small() -> None:
    field, card = load_field()
    assert packaged_field_path().stat().st_size <= 6e6
    assert card["target"] == "target"
    assert np.isfinite(np.asarray(density(field, jnp.zeros((1, 3), jnp.float32)))).all()


def cut(tensors: Tensors) -> None:
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


@pytest.mark.parametrize("change", [cut, widen, retype, spoil, swell, add, narrow, lengthen])
def test_a_file_with_other_tensors_is_refused(tmp_path: Path, change: Callable[[Tensors], None]) -> None:
    path = tmp_path / "field"
    save_field(ball(), path, {})
    tensors, metadata = read_tensors(path)
    change(tensors)
    write_tensors(path, tensors, metadata)
    with pytest.raises(WeightsError, match="expected") as error:
        load_field(path)
    assert len(str(error.value).splitlines()) == 1


def test_a_card_that_is_no_object_is_refused(tmp_path: Path) -> None:
    save_field(ball(), tmp_path / "field", {})
    tensors, metadata = read_tensors(tmp_path / "field")
    write_tensors(tmp_path / "field", tensors, {**metadata, "card": "[1]"})
    with pytest.raises(WeightsError, match="expected an object"):
        load_field(tmp_path / "field")


@pytest.mark.parametrize("content", [b"", b"x" * 100, b"\xff" * 8 + b"{}"])
def test_a_damaged_file_is_an_error_of_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "field"
    path.write_bytes(content)
    with pytest.raises(WeightsError, match="cannot be read") as error:
        load_field(path)
    assert len(str(error.value).splitlines()) == 1


def test_a_foreign_file_and_a_missing_one_are_refused(tmp_path: Path) -> None:
    write_tensors(tmp_path / "foreign", {"a": np.zeros(2)}, {"kind": "something else"})
    with pytest.raises(WeightsError, match="kind"):
        load_field(tmp_path / "foreign")
    with pytest.raises(WeightsError, match="cannot be read"):
        load_field(tmp_path / "nowhere")
