"""State of the relative orbit filter: what a search in vain does to it."""

import jax.numpy as jnp
import numpy as np
import rendezvous_scene

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import relative_filter_state


def test_a_search_without_success_doubles_the_variance_of_the_relative_state_alone(flight: FlightParams) -> None:
    before = rendezvous_scene.estimate(flight).relative
    after = relative_filter_state.reopen(before, jnp.asarray(True))
    factors = before.layout.vector(position=jnp.full(3, 2.0), velocity=jnp.full(3, 2.0)) + before.layout.vector(
        **{name: jnp.ones(size) for name, size in before.layout.after("velocity").blocks}
    )
    np.testing.assert_allclose(np.diagonal(after.covariance), factors * np.diagonal(before.covariance), rtol=1e-14)
    np.testing.assert_array_equal(
        relative_filter_state.reopen(before, jnp.asarray(False)).covariance, before.covariance
    )
    assert replace(after, covariance=before.covariance).r_TS_N is before.r_TS_N
