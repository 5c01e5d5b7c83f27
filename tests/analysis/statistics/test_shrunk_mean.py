"""The shrunk mean by hand."""

import numpy as np

from rpojax.analysis.statistics.intervals import shrunk_mean


def test_a_mean_is_shrunk_by_what_its_scatter_explains() -> None:
    rows = np.array([[1.0, 3.0, -2.0], [1.0, -3.0, -2.0], [1.0, 3.0, -2.2], [1.0, -3.0, -1.8]])
    np.testing.assert_allclose(shrunk_mean(rows), [1.0, 0.0, -2.0], rtol=0.01)
    np.testing.assert_allclose(shrunk_mean(np.array([[0.0], [2.0]])), [0.5])
