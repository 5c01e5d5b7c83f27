"""Control effort: the ratio of a consistent filter is one, and that of a wrong belief in burns is what theory says."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene

from rpojax.core.pytree import replace
from rpojax.flight import control_effort
from rpojax.flight.control_effort import ControlEffort
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate

INTERVAL, BURNS = 50, 600
BURN_SIGMA, NOISE = 0.01, np.array([0.05, 0.2, 1.0])


def filtered(true_sigma: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocity before and after each update (ticks, 3) and their variances (ticks, 2, 3), of a Kalman filter.

    A double integrator per axis, its position measured every second; burns have a velocity error that the filter
    believes to be `BURN_SIGMA` [m/s].
    """
    rng = np.random.default_rng(1)
    A = np.array([[1.0, 1.0], [0.0, 1.0]])
    velocities, variances = np.empty((INTERVAL * BURNS, 2, 3)), np.empty((INTERVAL * BURNS, 2, 3))
    for axis in range(3):
        x, estimate, P = np.zeros(2), np.zeros(2), np.diag([1.0, 1e-4])
        for tick in range(INTERVAL * BURNS):
            velocities[tick, 0, axis], variances[tick, 0, axis] = estimate[1], P[1, 1]
            gain = P[:, 0] / (P[0, 0] + NOISE[axis] ** 2)
            estimate = estimate + gain * (x[0] + NOISE[axis] * rng.normal() - estimate[0])
            P = P - np.outer(gain, P[0])
            velocities[tick, 1, axis], variances[tick, 1, axis] = estimate[1], P[1, 1]
            x, estimate, P = A @ x, A @ estimate, A @ P @ A.T
            if tick % INTERVAL == 0:
                x[1] += true_sigma * rng.normal()
                P[1, 1] += BURN_SIGMA**2
    return velocities[:, 0], velocities[:, 1], variances


@jax.jit
def ratios(flight: FlightParams, before: jax.Array, after: jax.Array, variances: jax.Array) -> jax.Array:
    """Fading ratio at every tick; a burn begins on every tick of a whole number of intervals."""
    estimate = rendezvous_scene.estimate(flight).relative

    def with_velocity(velocity: jax.Array, variance: jax.Array) -> RelativeEstimate:
        covariance = jnp.diag(jnp.pad(variance, (3, 6)))
        return replace(estimate, v_TS_N=velocity, covariance=covariance)

    def tick(effort: ControlEffort, now: tuple[jax.Array, ...]) -> tuple[ControlEffort, jax.Array]:
        velocity_before, velocity_after, variance, number = now
        prior, posterior = with_velocity(velocity_before, variance[0]), with_velocity(velocity_after, variance[1])
        effort = control_effort.update(effort, prior, posterior, number % INTERVAL == 0, jnp.asarray(False))
        return effort, effort.ratio

    numbers = jnp.arange(len(before))
    return jax.lax.scan(tick, control_effort.initial(), (before, after, variances, numbers))[1]


@pytest.mark.parametrize(("factor", "expected"), [(1.0, 1.0), (3.0, 8.0)])
def test_the_ratio_is_one_for_a_consistent_filter_and_grows_with_the_error_of_burns(
    flight: FlightParams, factor: float, expected: float
) -> None:
    before, after, variances = filtered(factor * BURN_SIGMA)
    found = ratios(flight, before, after, variances)
    # Three times the error has nine times the variance; the share of the measurements' own noise stays.
    assert float(jnp.mean(found)) == pytest.approx(expected, rel=0.15)


def test_intervals_with_an_inflated_covariance_or_without_measurements_do_not_count(flight: FlightParams) -> None:
    prior = rendezvous_scene.estimate(flight).relative
    posterior = replace(prior, v_TS_N=prior.v_TS_N + 1.0, covariance=0.5 * prior.covariance)
    true, false = jnp.asarray(True), jnp.asarray(False)
    effort = control_effort.update(control_effort.initial(), prior, posterior, true, true)
    effort = control_effort.update(effort, prior, prior, true, false)
    assert float(effort.ratio) == 1.0
    effort = control_effort.update(effort, prior, posterior, false, false)
    effort = control_effort.update(effort, prior, prior, true, false)
    square = 3.0 / (0.5 * float(jnp.sum(jnp.diag(prior.covariance)[3:6])))
    assert float(effort.ratio) == pytest.approx(1.0 + (square - 1.0) / 10.0)
