"""Image quality of worked cases."""

import numpy as np
import pytest

from rpojax.training.radiance_field import evaluate_field


def test_psnr_and_box_of_worked_cases() -> None:
    assert evaluate_field.psnr(np.full(10, 0.01)) == pytest.approx(20.0)
    alpha = np.zeros((8, 8), np.float32)
    alpha[2:5, 3:7] = 1.0
    alpha[2:5, 2] = 0.25
    np.testing.assert_allclose(evaluate_field.silhouette_box(alpha), [2.75, 2.0, 7.0, 5.0])
