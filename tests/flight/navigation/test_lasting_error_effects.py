"""Effects of errors that last: axes of the thrust, and what they do to the motion's mean and covariance."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from numpy_reference import random_covariance, random_unit, rotation_matrix

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import combined_orbit_filter, lasting_error_effects
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.lasting_error_effects import LastingEffects

SECOND = 1.0


@pytest.mark.parametrize("seed", range(4))
def test_the_axes_of_the_thrust_are_a_frame_that_turns_with_the_body(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q_BN, direction_B = random_unit(rng, 4), random_unit(rng, 3)
    axes = np.asarray(jax.jit(lasting_error_effects.thrust_axes)(q_BN, direction_B))
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(axes[0], rotation_matrix(q_BN).T @ direction_B, atol=1e-14)
    turned = np.asarray(lasting_error_effects.thrust_axes(jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.asarray(direction_B)))
    np.testing.assert_allclose(axes, turned @ rotation_matrix(q_BN), atol=1e-14)


def _moved(flight: FlightParams, known: OrbitEstimate, effects: LastingEffects, delta_v: jax.Array) -> OrbitEstimate:
    size = jnp.sqrt(jnp.sum(delta_v**2))
    return combined_orbit_filter.predict(
        flight.navigation, 2, known, delta_v, size, jnp.ones(()), jnp.zeros(3), effects, SECOND
    )


def test_a_burn_and_a_push_move_the_mean_and_the_covariance_by_their_derivative(flight: FlightParams) -> None:
    effects = LastingEffects(
        thrust_axes_N=jnp.asarray(rotation_matrix(random_unit(np.random.default_rng(1), 4))),
        ballistic_N=jnp.array([2e-5, -3e-5, 1e-5]),
    )
    delta_v = 2e-3 * effects.thrust_axes_N[0]
    known = rendezvous_scene.estimate(flight)
    names = ("burn_scale", "thrust_direction", "ballistic")

    def with_errors(x: jax.Array) -> OrbitEstimate:
        slow = dict(zip(names, (x[:1], x[1:3], x[3:]), strict=True))
        return replace(known, relative=replace(known.relative, slow={**known.relative.slow, **slow}))

    def motion(x: jax.Array) -> jax.Array:
        after = _moved(flight, with_errors(x), effects, delta_v)
        return jnp.concatenate([after.relative.r_TS_N, after.relative.v_TS_N])

    G = np.asarray(jax.jit(jax.jacfwd(motion))(jnp.zeros(4)))
    across = [effects.thrust_axes_N[1], effects.thrust_axes_N[2]]
    expected = np.stack([-delta_v, *(-2e-3 * axis for axis in across), SECOND * effects.ballistic_N], axis=1)
    np.testing.assert_allclose(G[3:], expected, rtol=1e-5, atol=1e-12)
    sigma = np.array([*np.full(6, 1e-9), *np.full(6, 1e-9), 0.02, 5e-3, 5e-3, 5e-3])
    P = random_covariance(np.random.default_rng(2), sigma)
    quiet = replace(
        flight.navigation,
        **dict.fromkeys(("relative_acceleration_noise", "burn_magnitude_sigma", "burn_direction_sigma"), jnp.zeros(())),
    )
    start = replace(with_errors(jnp.zeros(4)), relative=replace(known.relative, covariance=jnp.asarray(P)))
    after = _moved(replace(flight, navigation=quiet), start, effects, delta_v).relative
    of_errors = G @ P[12:, 12:] @ G.T
    units = np.sqrt(np.outer(np.diag(of_errors), np.diag(of_errors)))
    np.testing.assert_allclose(np.asarray(after.motion_covariance) / units, of_errors / units, atol=1e-4)
