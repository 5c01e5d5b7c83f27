"""Free motion between two positions, by the transition matrix itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.orbits import clohessy_wiltshire, two_impulse_transfer

RATE = 1.1e-3  # mean motion at 500 km
START, END = jnp.array([40.0, -300.0, 12.0]), jnp.array([5.0, -100.0, -30.0])
transition_matrix = jax.jit(clohessy_wiltshire.transition_matrix)
departure_velocity = jax.jit(two_impulse_transfer.departure_velocity)


def velocity(seconds: float) -> np.ndarray:
    dt = jnp.asarray(seconds)
    return np.asarray(departure_velocity(transition_matrix(jnp.asarray(RATE), dt), START, END, dt))


@pytest.mark.parametrize("seconds", [10.0, 200.0, 2500.0, 4000.0, 15000.0])
def test_the_motion_ends_at_the_position(seconds: float) -> None:
    matrix = np.asarray(transition_matrix(jnp.asarray(RATE), jnp.asarray(seconds)))
    found = matrix @ np.concatenate([START, velocity(seconds)])
    np.testing.assert_allclose(found[:3], END, atol=1e-9)


def test_a_short_transfer_is_nearly_straight() -> None:
    np.testing.assert_allclose(velocity(1.0), np.asarray(END - START), rtol=0.02, atol=0.5)


@pytest.mark.parametrize("turns", [0.5, 1.0, 1.5])
def test_at_times_without_a_solution_velocity_and_derivative_are_finite(turns: float) -> None:
    def speed(seconds: jax.Array) -> jax.Array:
        matrix = clohessy_wiltshire.transition_matrix(jnp.asarray(RATE), seconds)
        return jnp.sum(two_impulse_transfer.departure_velocity(matrix, START, END, seconds))

    value, slope = jax.jit(jax.value_and_grad(speed))(jnp.asarray(turns * 2.0 * np.pi / RATE))
    assert np.isfinite(value) and np.isfinite(slope)
