"""Tests of a filter's consistency against worked numbers, and on errors that are consistent, too sure or coloured."""

import numpy as np
import pytest

from rpojax.analysis.statistics.filter_consistency import (
    average_nees,
    chi_square_gate,
    coverage,
    coverage_of_ellipsoid,
    coverage_per_axis,
    innovation_squared,
    mean_nees_interval,
    nees,
    nis_interval,
    radius_of_ellipsoid,
    whiteness_bound,
    whiteness_test,
)


def test_nees_of_one_run_and_of_many_at_once() -> None:
    error, covariance = np.array([1.0, -2.0, 0.5]), np.diag([1.0, 4.0, 0.25])
    assert nees(error, covariance) == pytest.approx(3.0, rel=1e-15)
    root = np.array([[2.0, 0.0], [1.0, 3.0]])
    whitened = np.array([[1.0, 2.0], [0.0, -3.0]])
    many = nees(whitened @ root.T, np.stack([root @ root.T] * 2))
    np.testing.assert_allclose(many, [5.0, 9.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("runs", "components", "interval"),
    [
        (50, 6, (5.07825, 6.99749)),
        (100, 6, (5.34019, 6.69769)),
        (1000, 6, (5.78720, 6.21659)),
        (100, 12, (11.05890, 12.97898)),
    ],
)
def test_interval_of_the_mean_nees_against_worked_numbers(
    runs: int, components: int, interval: tuple[float, float]
) -> None:
    assert mean_nees_interval(components, runs) == pytest.approx(interval, abs=5.1e-6)


def test_nis_of_three_components_against_worked_numbers() -> None:
    assert nis_interval(3) == pytest.approx((0.215795, 9.348404), abs=5e-7)
    assert chi_square_gate(3, 0.99) == pytest.approx(11.344867, abs=5e-7)
    assert chi_square_gate(3, 0.9973) == pytest.approx(14.156253, abs=5e-7)
    assert nis_interval(3, 600) == pytest.approx((2.80718, 3.19913), abs=5e-6)


def test_whiteness_bound_against_a_worked_number() -> None:
    assert whiteness_bound(600) == pytest.approx(0.080017, abs=5e-7)


def test_sigma_coverage_against_worked_numbers() -> None:
    assert coverage_per_axis(3.0) == pytest.approx(0.9973002, abs=5e-8)
    assert coverage_of_ellipsoid(3.0, 3) == pytest.approx(0.9707091, abs=5e-8)
    assert radius_of_ellipsoid(0.9973, 2) == pytest.approx(3.43933, abs=5e-6)
    assert radius_of_ellipsoid(0.9973, 3) == pytest.approx(3.76248, abs=5e-6)


def test_circular_and_spherical_error_probable_against_worked_numbers() -> None:
    assert radius_of_ellipsoid(0.5, 2) == pytest.approx(1.177410, abs=5e-7)
    assert radius_of_ellipsoid(0.5, 3) == pytest.approx(1.538172, abs=5e-7)


RUNS, TICKS, COMPONENTS = 1000, 200, 3


@pytest.fixture(scope="module")
def white() -> np.ndarray:
    """Innovations of a consistent filter, a fifth of the ticks and one whole run without an update."""
    rng = np.random.default_rng(0)
    values = rng.normal(size=(RUNS, TICKS, COMPONENTS))
    values[rng.random((RUNS, TICKS)) < 0.2] = np.nan
    values[7] = np.nan
    return values


def test_consistent_innovations_lie_outside_as_often_as_said(white: np.ndarray) -> None:
    found = innovation_squared(white)
    # Twice the 95 % interval, and four sigma of a share of 0.05 among 999 runs.
    assert found.mean == pytest.approx(3.0, abs=found.interval[1] - found.interval[0])
    assert found.share_outside == pytest.approx(0.05, abs=0.028)
    assert np.flatnonzero(np.isnan(found.per_run)).tolist() == [7]
    assert found.per_run[3] == pytest.approx(np.nanmean(np.sum(white[3] ** 2, axis=1)), rel=1e-12)


def test_innovations_of_a_filter_that_is_too_sure_of_itself_are_too_large(white: np.ndarray) -> None:
    found = innovation_squared(1.3 * white)
    assert found.mean > found.interval[1]
    assert found.share_outside > 0.9


def test_white_innovations_are_found_white_and_coloured_ones_are_not(white: np.ndarray) -> None:
    assert whiteness_test(white).fraction_outside == pytest.approx(0.05, abs=0.028)
    coloured = np.empty((50, TICKS, 1))
    coloured[:, 0] = 0.0
    for tick in range(1, TICKS):
        coloured[:, tick] = 0.5 * coloured[:, tick - 1] + white[60:110, tick, :1]
        coloured[:, tick] = np.where(np.isnan(coloured[:, tick]), 0.0, coloured[:, tick])
    found = whiteness_test(coloured)
    assert found.fraction_outside > 0.9
    assert found.bound[0] == pytest.approx(whiteness_bound(TICKS - 1), rel=1e-12)


def test_autocorrelation_by_hand_across_a_gap() -> None:
    # Pairs (1, 2) and (3, -1); the gap parts 2 from 3: (2 - 3) / sqrt((1 + 9) (4 + 1)).
    found = whiteness_test(np.array([1.0, 2.0, np.nan, 3.0, -1.0]).reshape(1, 5, 1))
    assert found.autocorrelation[0] == pytest.approx(-1.0 / np.sqrt(50.0), rel=1e-12)
    assert found.bound[0] == pytest.approx(1.96 / np.sqrt(2.0), rel=1e-12)


def test_average_nees_tells_sure_modest_and_consistent_filters_apart() -> None:
    errors = np.random.default_rng(1).normal(size=(200, 300, 6))
    values = np.sum(errors**2, axis=2)
    values[:3, 5] = np.nan
    values[:, 6] = np.nan
    found = average_nees(values, 6)
    assert found.fraction_above + found.fraction_below == pytest.approx(0.05, abs=0.05)
    assert (found.low[0], found.high[0]) == pytest.approx(mean_nees_interval(6, 200), rel=1e-12)
    assert (found.low[5], found.high[5]) == pytest.approx(mean_nees_interval(6, 197), rel=1e-12)
    assert np.isnan([found.mean[6], found.low[6]]).all()
    assert average_nees(2.0 * values, 6).fraction_above == 1.0
    assert average_nees(0.5 * values, 6).fraction_below == 1.0


def test_coverage_is_a_mean_over_runs_with_their_spread() -> None:
    ratios = np.array([[0.5, -0.9, 2.0, np.nan], [0.1, 1.5, np.nan, np.nan], [np.nan] * 4])
    found = coverage(ratios, 1.0)
    assert found.fraction == pytest.approx((2.0 / 3.0 + 0.5) / 2.0, rel=1e-12)
    # Two shares a sixth apart: their standard deviation is 1 / (6 sqrt 2), that of the mean 1 / 12.
    assert found.interval[1] - found.fraction == pytest.approx(1.96 / 12.0, rel=1e-12)
    drawn = coverage(np.random.default_rng(2).normal(size=(400, 50, 3)), 2.0)
    assert drawn.interval[0] < drawn.expected < drawn.interval[1]


def test_without_any_update_nothing_is_claimed() -> None:
    nothing = np.full((2, 5, 3), np.nan)
    assert np.isnan([innovation_squared(nothing).mean, *innovation_squared(nothing).interval]).all()
    assert np.isnan(whiteness_test(nothing).fraction_outside)
    assert np.isnan(coverage(nothing, 3.0).fraction)
