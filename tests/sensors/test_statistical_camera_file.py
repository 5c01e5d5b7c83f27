"""Files of fitted statistical cameras."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from synthetic_camera_statistics import fitted

from rpojax.core.pytree import replace
from rpojax.sensors import statistical_camera_file
from rpojax.vision.weight_files import WeightsError


def test_a_fitted_camera_survives_a_file(tmp_path: Path) -> None:
    path = tmp_path / "a.camera.safetensors"
    statistics = fitted(0.7, 0.1, 0.02)
    statistical_camera_file.save_statistics(statistics, path, {"samples": 3})
    found, card = statistical_camera_file.load_statistics(path)
    assert card == {"samples": 3}
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(statistics), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("content", "words"), [(b"", "cannot be read"), (b"x" * 400, "cannot be read")])
def test_a_damaged_file_is_rejected_in_one_line(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "a.camera.safetensors"
    path.write_bytes(content)
    with pytest.raises(WeightsError, match=words) as error:
        statistical_camera_file.load_statistics(path)
    assert "\n" not in str(error.value)


def test_a_file_of_another_kind_is_rejected(tmp_path: Path) -> None:
    from rpojax.vision.radiance_field.field_file import packaged_field_path

    with pytest.raises(WeightsError, match="calibrate-camera-model"):
        statistical_camera_file.load_statistics(packaged_field_path())


@pytest.mark.parametrize("number", [0.0, -1.0])
@pytest.mark.parametrize("name", ["spread", "lasting_angle"])
def test_a_scale_that_is_not_positive_is_rejected_by_name(tmp_path: Path, name: str, number: float) -> None:
    path = tmp_path / "a.camera.safetensors"
    statistics = fitted(0.7, 0.1)
    numbers = np.array(getattr(statistics, name))
    numbers.flat[-1] = number
    statistical_camera_file.save_statistics(replace(statistics, **{name: jnp.asarray(numbers)}), path, {})
    with pytest.raises(WeightsError, match=f"{name}: found a number that is not positive, expected positive numbers"):
        statistical_camera_file.load_statistics(path)
