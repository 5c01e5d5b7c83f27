"""Statistical linearisation against closed forms of the dead zone and of the square."""

import numpy as np
import pytest
from scipy.stats import norm

from rpojax.analysis.linear_covariance.burn_decision import normal_points, statistical_linearisation

# The edges of the dead zone fall between points: one point in 4096 on the wrong side moves a mean by about 1e-3.
CLOSE = 3e-3


def dead_zone(u: np.ndarray) -> np.ndarray:
    """What is larger than one passes as it is, the rest not at all."""
    return np.where(np.abs(u) > 1.0, u, 0.0)


def closed_form(mean: float, sigma: float) -> tuple[float, float, float]:
    """Mean, gain and mean square of the dead zone's output for a normal input, by integrating its density."""
    a, b = (-1.0 - mean) / sigma, (1.0 - mean) / sigma
    tails = norm.cdf(a) + norm.sf(b)
    first = sigma * (norm.pdf(b) - norm.pdf(a))
    second = sigma**2 * (tails + b * norm.pdf(b) - a * norm.pdf(a))
    output = mean * tails + first
    square = mean**2 * tails + 2.0 * mean * first + second
    return float(output), float((mean * first + second) / sigma**2), float(square)


@pytest.mark.parametrize(("mean", "sigma"), [(0.0, 0.5), (0.0, 1.0), (0.0, 4.0), (0.7, 0.6), (-2.0, 0.5)])
def test_a_normal_number_through_a_dead_zone(mean: float, sigma: float) -> None:
    found = statistical_linearisation(dead_zone, np.array([mean]), np.array([[sigma**2]]), normal_points(1, 12))
    output, gain, square = closed_form(mean, sigma)
    assert found.mean[0] == pytest.approx(output, abs=CLOSE)
    assert found.gain[0, 0] == pytest.approx(gain, abs=2.0 * CLOSE / sigma)
    residual = square - output**2 - gain**2 * sigma**2
    assert found.residual[0, 0] == pytest.approx(residual, abs=4.0 * CLOSE * max(1.0, sigma))


def test_a_linear_function_has_its_own_matrix_as_gain_and_no_residual() -> None:
    matrix = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 1.0]])
    root = np.array([[1.0, 0.0, 0.0], [0.3, 2.0, 0.0], [-0.2, 0.1, 0.5]])
    found = statistical_linearisation(
        lambda u: u @ matrix.T, np.array([1.0, 2.0, 3.0]), root @ root.T, normal_points(3, 6)
    )
    np.testing.assert_allclose(found.gain, matrix, atol=1e-12)
    np.testing.assert_allclose(found.mean, matrix @ [1.0, 2.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-12)


def test_a_square_of_a_centred_number_has_no_gain_and_all_of_its_variance_is_left() -> None:
    found = statistical_linearisation(np.square, np.zeros(1), np.array([[4.0]]), normal_points(1, 14))
    assert found.mean[0] == pytest.approx(4.0, rel=1e-6)
    assert found.gain[0, 0] == pytest.approx(0.0, abs=0.02)
    assert found.residual[0, 0] == pytest.approx(2.0 * 4.0**2, rel=0.01)


def test_a_direction_without_spread_has_no_gain() -> None:
    found = statistical_linearisation(lambda u: u, np.zeros(2), np.diag([1.0, 0.0]), normal_points(2, 6))
    np.testing.assert_allclose(found.gain, np.diag([1.0, 0.0]), atol=1e-12)


def test_the_points_have_mean_zero_and_unit_covariance() -> None:
    points = normal_points(3, 7)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-13)
    np.testing.assert_allclose(points.T @ points / len(points), np.eye(3), atol=1e-12)
