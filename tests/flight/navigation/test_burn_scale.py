"""Lasting error of burns: its covariance by a dense derivative, and what several burns teach of it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from numpy_reference import random_covariance

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import combined_orbit_filter, lasting_error_effects
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

DELTA_V = jnp.array([1.2e-3, -5e-4, 7e-4])
SIGMA = np.array([*np.full(3, 0.3), *np.full(3, 2e-3), 0.065, 0.14, 5e-4, 5e-4, 5e-3, 5e-3, 0.015, 0.01, 0.01, 5e-3])
FIRST_ORDER = 2e-6
"""Of the transition over one second, a kick followed by a drift."""


def burn(tuning: OrbitFilterTuning, estimate: OrbitEstimate, delta_v: jax.Array = DELTA_V) -> OrbitEstimate:
    size = jnp.linalg.norm(delta_v)
    return combined_orbit_filter.predict(
        tuning, 2, estimate, delta_v, size, jnp.ones(()), jnp.zeros(3), lasting_error_effects.none(), 1.0
    )


burn_compiled = jax.jit(burn)


def test_the_covariance_agrees_with_the_derivative_of_the_mean(flight: FlightParams) -> None:
    tuning = replace(flight.navigation, burn_magnitude_sigma=0.0 * DELTA_V[0], burn_direction_sigma=0.0 * DELTA_V[0])
    known = rendezvous_scene.estimate(flight, v_TS_N=np.array([0.05, -0.03, 0.02]))
    P = random_covariance(np.random.default_rng(4), SIGMA)
    # Of the errors of burns, the direction is known here.
    direction = known.relative.layout["thrust_direction"]
    P[direction], P[:, direction] = 0.0, 0.0

    def estimate_at(x: jax.Array) -> OrbitEstimate:
        relative = replace(
            known.relative,
            r_TS_N=known.relative.r_TS_N + x[:3],
            v_TS_N=known.relative.v_TS_N + x[3:6],
            slow={**known.relative.slow, "burn_scale": x[6:]},
            covariance=jnp.asarray(P),
        )
        return OrbitEstimate(servicer=known.servicer, relative=relative)

    def motion_after(x: jax.Array) -> jax.Array:
        after = burn(tuning, estimate_at(x)).relative
        return jnp.concatenate([after.r_TS_N, after.v_TS_N, after.slow["burn_scale"]])

    places = [*range(6), *known.relative.layout.places("burn_scale")]
    F = np.asarray(jax.jit(jax.jacfwd(motion_after))(jnp.zeros(7)))
    Q = np.zeros((7, 7))
    Q[3:6, 3:6] = np.eye(3) * float(tuning.relative_acceleration_noise) ** 2
    expected = F @ P[np.ix_(places, places)] @ F.T + Q
    after = burn_compiled(tuning, estimate_at(jnp.zeros(7))).relative
    found = np.asarray(after.covariance)[np.ix_(places, places)]
    units = np.outer(SIGMA[places], SIGMA[places])
    np.testing.assert_allclose(found / units, expected / units, atol=FIRST_ORDER)
    assert np.max(np.abs(F[3:6, 6])) == pytest.approx(1.2e-3)


def test_errors_of_two_burns_add_up_as_they_are_the_same(flight: FlightParams) -> None:
    sigma = 0.02
    tuning = replace(
        flight.navigation,
        burn_scale_sigma=jnp.asarray(sigma),
        burn_magnitude_sigma=0.0 * DELTA_V[0],
        burn_direction_sigma=0.0 * DELTA_V[0],
        relative_acceleration_noise=0.0 * DELTA_V[0],
    )
    start = rendezvous_scene.estimate(flight)
    variance = start.relative.layout.vector(burn_scale=jnp.asarray([sigma**2]))
    relative = replace(start.relative, covariance=jnp.diag(variance))
    once = burn_compiled(tuning, replace(start, relative=relative))
    twice = burn_compiled(tuning, once)
    for estimate, count in ((once, 1), (twice, 2)):
        P = np.asarray(estimate.relative.covariance)
        total = np.sqrt(np.trace(P[3:6, 3:6]))
        np.testing.assert_allclose(total, count * sigma * np.linalg.norm(DELTA_V), rtol=1e-5)


def test_without_a_lasting_error_it_stays_zero(flight: FlightParams) -> None:
    tuning = replace(flight.navigation, burn_scale_sigma=jnp.zeros(()))
    start = rendezvous_scene.estimate(replace(flight, navigation=tuning))
    after = burn_compiled(tuning, start).relative
    np.testing.assert_array_equal(after.slow["burn_scale"], 0.0)
    np.testing.assert_array_equal(after.covariance[after.layout["burn_scale"]], 0.0)
