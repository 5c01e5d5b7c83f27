"""State of the relative orbit filter: what a search in vain does to it."""

import jax.numpy as jnp
import numpy as np
import rendezvous_scene

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import relative_filter_state
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget


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


def test_errors_of_a_landmark_network_change_as_the_target_turns_before_the_camera(flight: FlightParams) -> None:
    tuning, target = flight.navigation, BelievedTarget(inertia=jnp.eye(3), landmarks=jnp.zeros((6, 3)))
    states = relative_filter_state.states_with(["landmarks", "landmark_network"])
    # The line of sight turns by a milliradian a second about z, as the target does: its view stays.
    r_TS_N, v_TS_N, turn = jnp.array([10.0, 0.0, 0.0]), jnp.array([0.0, 0.01, 0.0]), np.array([0.0, 0.0, 1e-3])
    made = relative_filter_state.initial(tuning, r_TS_N, v_TS_N, states, target)
    for rate, angle in ((turn, 0.0), (turn + np.array([0.02, 0.0, 0.0]), 0.02), (np.zeros(3), 1e-3)):
        estimate = replace(made, slow=made.slow | {"rate": jnp.asarray(rate)})
        decay, variance = relative_filter_state.slow_process(tuning, estimate, r_TS_N, v_TS_N, 3.0)
        blocks = made.layout.after("velocity")
        expected = np.exp(-3.0 * angle / float(tuning.network_angle))
        for name, sigmas in (
            ("network_turn", np.asarray(tuning.network_turn_sigma)),
            ("network_place", np.asarray(tuning.network_place_sigma)),
        ):
            np.testing.assert_allclose(blocks.split(decay)[name], expected, rtol=1e-9)
            of_axes = sigmas[[0, 0, 1]] ** 2 * (1.0 - expected**2)
            np.testing.assert_allclose(blocks.split(variance)[name], of_axes, atol=1e-12)
