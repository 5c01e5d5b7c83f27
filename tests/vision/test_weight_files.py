"""Tensors and model cards of weight files, and errors for damaged ones."""

from pathlib import Path

import numpy as np
import pytest

from rpojax.vision.weight_files import (
    WeightsError,
    check_all_taken,
    packaged_file,
    read_model_card,
    read_tensors,
    take_tensor,
    write_tensors,
)


def test_tensors_and_metadata_are_read_back(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "weights"
    values = np.arange(6, dtype=np.float32).reshape(2, 3)
    write_tensors(path, {"a": values}, {"kind": "test", "card": '{"name": 1}'})
    tensors, metadata = read_tensors(path)
    np.testing.assert_array_equal(tensors["a"], values)
    assert metadata["kind"] == "test"
    assert read_model_card(path, metadata) == {"name": 1}


@pytest.mark.parametrize("card", ["[1]", "no JSON"])
def test_invalid_model_card_is_refused(card: str) -> None:
    with pytest.raises(WeightsError, match="expected an object"):
        read_model_card(Path("weights"), {"card": card})


@pytest.mark.parametrize("content", [b"", b"x" * 100, b"\xff" * 8 + b"{}"])
def test_damaged_file_is_an_error_of_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "weights"
    path.write_bytes(content)
    with pytest.raises(WeightsError, match="cannot be read") as error:
        read_tensors(path)
    assert len(str(error.value).splitlines()) == 1


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="cannot be read"):
        read_tensors(tmp_path / "nowhere")


def test_take_tensor_checks_name_shape_type_and_values() -> None:
    path = Path("weights")
    tensors = {"a": np.zeros((2, 3), np.float32), "b": np.full(2, np.nan)}
    with pytest.raises(WeightsError, match="missing"):
        take_tensor(path, tensors, "c", (2,), np.float32)
    with pytest.raises(WeightsError, match="not finite"):
        take_tensor(path, tensors, "b", (2,), np.float64)
    for shape, dtype in (((3, 3), np.float32), ((None,), np.float32), ((2, None), np.float64)):
        with pytest.raises(WeightsError, match="expected"):
            take_tensor(path, dict(tensors), "a", shape, dtype)
    assert take_tensor(path, tensors, "a", (2, None), np.float32).shape == (2, 3)
    check_all_taken(path, tensors)
    with pytest.raises(WeightsError, match="expected no such"):
        check_all_taken(path, {"more": np.zeros(1)})


def test_packaged_files_exist() -> None:
    assert packaged_file("detector.safetensors").is_file()
