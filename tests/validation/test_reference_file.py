"""Damaged and invalid reference files are refused with a reason."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.validation import replay
from experiments.validation.reference_file import FormatError, read_reference

TUMBLE = Path(__file__).parent / "references" / "d_tumble.npz"


def write(folder: Path, **changes: Any) -> Path:
    """A short tumble with changed keys; None leaves one out."""
    arrays: dict[str, Any] = {**read_reference(TUMBLE).arrays, **changes}
    path = folder / "changed.npz"
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path


def test_any_damage_to_an_archive_is_refused_or_harmless(tmp_path: Path) -> None:
    content = write(tmp_path).read_bytes()
    path = tmp_path / "damaged.npz"
    for place in range(0, len(content), 97):
        path.write_bytes(content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :])
        try:
            read_reference(path)
        except FormatError as refused:
            assert "\n" not in str(refused)


ONE_THRUSTER = {"thr_loc": np.zeros((1, 3)), "thr_dir": np.eye(3)[:1], "F_max": np.ones(1)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t": None}, "'t' is missing"),
        ({"I": None}, "'I' is missing"),
        ({"q": None, "sigma_BN": None}, "nothing to compare"),
        ({"q": np.ones((3, 4)) / 2.0}, "'q': found shape"),
        ({"omega": np.full((99, 3), np.nan)}, "not finite"),
        ({"t": np.arange(99.0)[::-1]}, "times that increase"),
        ({"I": np.array([["a"] * 3] * 3)}, "expected numbers"),
        ({"I": np.array([[2.0, 0.1, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]])}, "'I': found a tensor that is not symm"),
        ({"I": np.diag([1.0, -1.0, 1.0])}, "'I': found a principal moment of -1"),
        ({"I": np.diag([1.0, 1.0, 2.1])}, "'I': found moments 1, 1, 2.1, expected"),
        ({"m": np.array(0.0)}, "'m': found 0, expected more than 0"),
        ({"omega0": np.array([1e4, 0.0, 0.0])}, "steps to simulate, expected 5e"),
        ({**ONE_THRUSTER, "thr_dir": np.zeros((1, 3)), "burns": np.zeros((1, 3))}, "'thr_dir': found a direction of"),
        ({"meta_json": np.array("{")}, "not JSON"),
        ({"burns": np.array([[0.0, 1.0, 1.0]])}, "'F_max' is missing: found 'burns', expected"),
        (ONE_THRUSTER, "'burns' is missing"),
        ({**ONE_THRUSTER, "burns": np.array([[1.0, 1.0, 1.0]])}, "not one of the 1"),
        ({"t_cmd": np.array([0.0, 1.0])}, "'u_cmd' is missing: found 't_cmd'"),
        ({"Omega": np.zeros((99, 3))}, "'gs' is missing: found 'Omega'"),
        ({"R_sun": np.array(7e8)}, "'Re_eclipse' is missing: found 'R_sun'"),
        ({"u_cmd": np.zeros((2, 3)), "t_cmd": np.array([0.0, 1.0])}, "'gs' is missing"),
        ({"Cr": np.array(1.2)}, "is missing"),
    ],
)
def test_a_file_that_is_not_of_the_format_is_refused_with_a_reason(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    path = write(tmp_path, **changes)
    with pytest.raises(FormatError, match=message) as refused:
        replay.replay(read_reference(path))
    assert "\n" not in str(refused.value)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="nowhere"):
        read_reference(tmp_path / "nowhere.npz")
