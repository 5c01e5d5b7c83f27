"""Percentiles over runs against numpy."""

import numpy as np

from rpojax.analysis.statistics.intervals import percentiles_over_runs


def test_percentiles_agree_with_numpy_column_by_column_and_leave_out_nan() -> None:
    values = np.random.default_rng(3).normal(size=(31, 4))
    values[:7, 1] = np.nan
    values[:, 2] = np.nan
    values[1:, 3] = np.nan
    found = percentiles_over_runs(values, (0.0, 5.0, 50.0, 99.0, 100.0))
    for column in (0, 1, 3):
        finite = values[np.isfinite(values[:, column]), column]
        np.testing.assert_allclose(found[:, column], np.percentile(finite, [0, 5, 50, 99, 100]))
    assert np.isnan(found[:, 2]).all()
