"""Bootstrap of medians against resamples drawn one by one."""

import numpy as np

from rpojax.analysis.statistics.intervals import resampled_medians


def test_resampled_medians_are_those_of_pairs_drawn_with_replacement() -> None:
    for count in (11, 400, 2001):  # odd and even, all ranks and only those near the middle
        columns = np.random.default_rng(2).normal(size=(3, count)).round(2)
        found = resampled_medians(columns, np.random.default_rng(3))
        assert found.shape == (3, 999)
        again = np.random.default_rng(3)
        drawn = again.integers(count, size=(50, count))
        np.testing.assert_array_equal(found[:, :50], np.median(columns[:, drawn], axis=2))
