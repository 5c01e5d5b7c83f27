"""Initial weights from files of this and other layouts."""

from pathlib import Path

import jax
import numpy as np
import pytest

from rpojax.training.detector.train_detector import initial_weights
from rpojax.vision.detector import two_stage_detector
from rpojax.vision.detector.detector_file import save_detector
from rpojax.vision.weight_files import WeightsError, read_tensors, write_tensors


def test_layers_that_agree_are_taken_and_others_are_untrained(tmp_path: Path) -> None:
    path = tmp_path / "weights"
    other = two_stage_detector.initialize(jax.random.key(7))
    save_detector(other, path, {"command": "before"})
    tensors, metadata = read_tensors(path)
    tensors["second.stem.kernel"] = np.zeros((3, 3, 4, 16), np.float16)
    write_tensors(path, tensors, {**metadata, "kind": "rpojax detector 2"})
    params, card = initial_weights(path, seed=0)
    fresh, _ = initial_weights(None, seed=0)
    assert card == {"command": "before"}
    np.testing.assert_allclose(
        params["proposal"]["down1"]["kernel"], other["proposal"]["down1"]["kernel"], rtol=1e-3, atol=1e-6
    )
    np.testing.assert_array_equal(params["refinement"]["stem"]["kernel"], fresh["refinement"]["stem"]["kernel"])


def test_file_without_a_layer_that_fits_is_refused(tmp_path: Path) -> None:
    write_tensors(tmp_path / "a", {"first.stem.kernel": np.zeros(3, np.float16)}, {"kind": "rpojax detector 1"})
    write_tensors(tmp_path / "b", {}, {"kind": "rpojax field 1"})
    for name in ("a", "b"):
        with pytest.raises(WeightsError, match="expected a detector to start from"):
            initial_weights(tmp_path / name, seed=0)
