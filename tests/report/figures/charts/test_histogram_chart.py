"""Bins of histograms."""

import numpy as np
import pytest

from rpojax.report.figures.plotly_charts import histogram_bins


@pytest.mark.parametrize("values", [[0.0], [0.3, 0.3 + 1e-16, 0.3], [1.0, 2.0, 5.0], [-1e9, 1e9], [1e-9, 2e-9]])
def test_every_value_is_in_a_bin(values):
    counts, edges = histogram_bins(np.array(values))
    assert counts.sum() == len(values)
    assert len(edges) == len(counts) + 1
    assert len(counts) <= 37
