"""HSIC against worked numbers and the trace of the centred kernels."""

import numpy as np
import pytest

from rpojax.analysis.statistics.dependence import kernel_factor, normalised_hsic


def hsic(x: np.ndarray, y: np.ndarray) -> float:
    """HSIC of `x` (n,) and `y` (n,) from their kernel factors, divided by n^2."""
    return float(np.sum(np.square(kernel_factor(x).T @ kernel_factor(y)))) / len(x) ** 2


def test_hsic_against_worked_numbers() -> None:
    x = np.arange(4.0)
    assert hsic(x, x) == pytest.approx(0.0722874, abs=5e-8)
    assert hsic(x, np.array([0.0, 1.0, 1.0, 0.0])) == pytest.approx(0.0126002, abs=5e-8)


def test_hsic_is_the_trace_of_the_centred_kernels() -> None:
    rng = np.random.default_rng(4)
    x = rng.normal(size=60)
    y = np.round(x**2 + rng.normal(size=60), 1)

    def kernel(values: np.ndarray) -> np.ndarray:
        distance = np.abs(values[:, None] - values)
        return np.exp(-0.5 * (distance / np.median(distance[np.triu_indices(60, 1)])) ** 2)

    center = np.eye(60) - 1.0 / 60.0
    expected = np.trace(kernel(x) @ center @ kernel(y) @ center) / 3600.0
    assert hsic(x, y) == pytest.approx(expected, rel=1e-8)
    centred = center @ kernel(x) @ center
    rough = kernel_factor(x, 1e-3)
    assert rough.shape[1] < 15
    assert np.trace(centred - rough @ rough.T) < 1e-3 * 60.0


def test_hsic_of_a_quantity_that_hardly_varies() -> None:
    rare = np.zeros(40)
    rare[:3] = 1.0
    assert hsic(rare, rare) > 0.0
    assert hsic(np.zeros(40), rare) == pytest.approx(0.0, abs=1e-15)


def test_normalised_hsic_is_one_for_equal_quantities_and_significant() -> None:
    x = np.random.default_rng(5).normal(size=200)
    inputs = np.stack([x, np.random.default_rng(6).normal(size=200)], axis=1)
    found, p_values = normalised_hsic(inputs, x, 0.05, np.random.default_rng(0))
    assert found[0] == pytest.approx(1.0, abs=1e-5)
    assert p_values[0] < 0.05 < p_values[1]
    expected = hsic(inputs[:, 1], x) / np.sqrt(hsic(inputs[:, 1], inputs[:, 1]) * hsic(x, x))
    assert found[1] == pytest.approx(expected, abs=0.01)
