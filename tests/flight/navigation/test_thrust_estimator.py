"""Thrust estimator against a scalar Kalman filter written by hand, with beliefs other than the packaged ones."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import thrust_estimator
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

initial, inflation = jax.jit(thrust_estimator.initial), jax.jit(thrust_estimator.sigma_inflation)
update = jax.jit(thrust_estimator.update, static_argnums=3)
PRESSURES = (1.02, 0.97, 1.01, 0.99)
BELIEFS = [(0.015, 0.01, 0.03), (0.05, 0.01, 0.03), (0.015, 0.04, 0.03), (0.015, 0.01, 0.08)]


def believing(flight: FlightParams, sigma: float, walk: float, noise: float) -> OrbitFilterTuning:
    """Tuning with beliefs about thrust and pressure."""
    numbers = {"thrust_sigma": sigma, "thrust_walk": walk, "pressure_noise": noise}
    return replace(flight.navigation, **{name: jnp.asarray(value) for name, value in numbers.items()})


@pytest.mark.parametrize("belief", BELIEFS)
def test_the_estimate_is_that_of_a_kalman_filter_with_the_beliefs_of_the_scenario(
    flight: FlightParams, belief: tuple[float, float, float]
) -> None:
    tuning, dt = believing(flight, *belief), 0.5
    sigma, walk, noise = belief
    estimate, ratio, variance = initial(tuning), 1.0, sigma**2
    for pressure in PRESSURES:
        estimate = update(tuning, estimate, jnp.asarray(pressure), dt)
        variance += walk**2 * dt
        gain = variance / (variance + noise**2)
        ratio, variance = ratio + gain * (pressure - ratio), (1.0 - gain) * variance
    np.testing.assert_allclose(estimate.ratio, ratio, rtol=1e-14)
    np.testing.assert_allclose(estimate.variance, variance, rtol=1e-14)
    expected = max(np.sqrt(variance) / (1.2 * sigma), 1.0)
    np.testing.assert_allclose(inflation(tuning, estimate), expected, rtol=1e-14)


@pytest.mark.parametrize(("noise", "jumps"), [(0.03, True), (0.15, False)])
def test_what_is_a_failure_depends_on_the_believed_noise_of_the_sensor(
    flight: FlightParams, noise: float, jumps: bool
) -> None:
    tuning = believing(flight, 0.015, 0.01, noise)
    after = update(tuning, initial(tuning), jnp.asarray(0.7), 1.0)
    # A jump of 0.3 is ten sigma of the packaged sensor and two of a noisy one.
    assert (float(after.ratio) < 0.71) is jumps


@partial(jax.jit, static_argnums=2)
def steady(tuning: OrbitFilterTuning, pressure: jax.Array, steps: int) -> jax.Array:
    def step(estimate: thrust_estimator.ThrustEstimate, _: None) -> tuple[thrust_estimator.ThrustEstimate, None]:
        return thrust_estimator.update(tuning, estimate, pressure, 1.0), None

    return jnp.sqrt(jax.lax.scan(step, thrust_estimator.initial(tuning), None, length=steps)[0].variance)


def test_a_long_burn_of_a_calibrated_thruster_inflates_nothing(flight: FlightParams) -> None:
    q, r = 0.01**2, 0.03**2
    sigma = float(steady(believing(flight, 0.015, 0.01, 0.03), jnp.asarray(1.0), 60))
    np.testing.assert_allclose(sigma, np.sqrt(0.5 * (np.sqrt(q * q + 4.0 * q * r) - q)), rtol=1e-9)  # Riccati
    assert sigma < 1.2 * 0.015
