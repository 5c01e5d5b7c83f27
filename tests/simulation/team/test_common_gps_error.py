"""Correlation of the receivers' slow errors."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.simulation.team import common_gps_error


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("share", [0.0, 0.6, 0.95])
def test_any_two_receivers_have_the_share_in_common(count: int, share: float) -> None:
    # Columns of the identity give the rows of the factor.
    factor = np.asarray(common_gps_error.correlate(jnp.asarray(share), jnp.eye(count)))
    expected = np.full((count, count), share) + (1.0 - share) * np.eye(count)
    np.testing.assert_allclose(factor.T @ factor, expected, atol=1e-12)
    np.testing.assert_array_equal(factor[:, 0], np.eye(count)[:, 0])
