"""State of the relative orbit filter: what a search in vain does to it."""

import jax.numpy as jnp
import numpy as np
import rendezvous_scene

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import relative_estimate


def test_a_search_without_success_doubles_the_variance_of_the_relative_state_alone(flight: FlightParams) -> None:
    before = rendezvous_scene.estimate(flight).relative
    after = relative_estimate.reopen(before, jnp.asarray(True))
    ratio = np.asarray(after.covariance).diagonal() / np.asarray(before.covariance).diagonal()
    np.testing.assert_allclose(ratio, [2.0] * 6 + [1.0] * 6)
    np.testing.assert_array_equal(relative_estimate.reopen(before, jnp.asarray(False)).covariance, before.covariance)
    assert replace(after, covariance=before.covariance).r_TS_N is before.r_TS_N
