"""Rotations of the example node agree with SciPy."""

import numpy as np
import pytest
from experiment_modules import load_experiment
from scipy.spatial import transform

EXAMPLE = load_experiment("ros2_interop/rotation.py")
TURNS = [
    np.zeros(3),
    np.array([1e-9, 0.0, 0.0]),
    np.array([0.3, -0.2, 0.9]),
    np.array([0.0, 3.0, 0.5]),
    *(3.14159 * axis for axis in np.eye(3)),
]


@pytest.mark.parametrize("first", TURNS, ids=str)
@pytest.mark.parametrize("second", TURNS, ids=str)
def test_rotations_agree_with_scipy(first: np.ndarray, second: np.ndarray) -> None:
    ours = EXAMPLE.Rotation.from_rotvec(second) * EXAMPLE.Rotation.from_rotvec(first).inv()
    theirs = transform.Rotation.from_rotvec(second) * transform.Rotation.from_rotvec(first).inv()
    matrix = theirs.as_matrix()
    vector = np.array([0.3, -1.7, 2.9])
    np.testing.assert_allclose(ours.apply(vector), theirs.apply(vector), rtol=0.0, atol=1e-14)
    for same in (ours, EXAMPLE.Rotation.from_quat(ours.as_quat()), EXAMPLE.Rotation.from_matrix(matrix)):
        seen = np.stack([same.apply(axis) for axis in np.eye(3)], axis=1)
        np.testing.assert_allclose(seen, matrix, rtol=0.0, atol=1e-14)
        again = transform.Rotation.from_rotvec(same.as_rotvec()).as_matrix()
        np.testing.assert_allclose(again, matrix, rtol=0.0, atol=1e-14)
        assert np.linalg.norm(same.as_rotvec()) <= np.pi + 1e-12


def test_the_cross_product_agrees_with_numpy() -> None:
    a, b = np.array([0.1, -2.0, 3.0]), np.array([4.0, 0.5, -6.0])
    np.testing.assert_allclose(EXAMPLE.cross(a, b), np.cross(a, b), rtol=1e-15)
