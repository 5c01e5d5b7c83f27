"""NEES averaged over runs against worked numbers, and on errors that are consistent or not."""

import numpy as np
import pytest

from rpojax.analysis.statistics.filter_consistency_intervals import average_nees, mean_square_interval


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
    assert mean_square_interval(components, runs) == pytest.approx(interval, abs=5.1e-6)


def test_average_nees_tells_overconfident_conservative_and_consistent_filters_apart() -> None:
    errors = np.random.default_rng(1).normal(size=(200, 300, 6))
    values = np.sum(errors**2, axis=2)
    values[:3, 5] = np.nan
    values[:, 6] = np.nan
    found = average_nees(values, 6)
    assert found.fraction_above + found.fraction_below == pytest.approx(0.05, abs=0.05)
    assert (found.low[0], found.high[0]) == pytest.approx(mean_square_interval(6, 200), rel=1e-12)
    assert (found.low[5], found.high[5]) == pytest.approx(mean_square_interval(6, 197), rel=1e-12)
    assert np.isnan([found.mean[6], found.low[6]]).all()
    assert average_nees(2.0 * values, 6).fraction_above == 1.0
    assert average_nees(0.5 * values, 6).fraction_below == 1.0
