"""Priors of errors that last: the exact posterior of a wider prior, its brake, and what is left alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import lasting_adaptation, relative_filter_state
from rpojax.flight.navigation.lasting_adaptation import LastingPriors
from rpojax.flight.navigation.relative_filter_state import SIGMA_MARGIN, RelativeEstimate

PLACE = 12
"""Of the scale of burns in the filter's vector."""
SIGMA = 0.02
NOISE = 0.01


@pytest.fixture(scope="module")
def start(flight: FlightParams) -> RelativeEstimate:
    navigation = replace(flight.navigation, burn_scale_sigma=jnp.asarray(SIGMA / SIGMA_MARGIN))
    return rendezvous_scene.estimate(replace(flight, navigation=navigation)).relative


def learnt(start: RelativeEstimate, prior_sigma: float, value: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean deviation and covariance after measurements of the scale, and of its sum with a position, in closed form."""
    P0 = np.array(start.covariance)
    P0[PLACE, PLACE] = prior_sigma**2
    H = np.zeros((2, len(P0)))
    H[0, PLACE] = 1.0
    H[1, PLACE], H[1, 0] = 30.0, 1.0
    gain = P0 @ H.T @ np.linalg.inv(H @ P0 @ H.T + np.diag([NOISE**2, 0.1**2]))
    measured = np.array([value, 30.0 * value])
    return gain @ measured, P0 - gain @ H @ P0


def adapted(
    flight: FlightParams, start: RelativeEstimate, value: float, limit: float = 6.0
) -> tuple[RelativeEstimate, LastingPriors, float]:
    mean, P = learnt(start, SIGMA, value)
    layout = start.layout
    blocks = layout.split(jnp.asarray(mean))
    slow = {name: start.slow[name] + blocks[name] for name in start.slow}
    known = replace(
        start, r_TS_N=start.r_TS_N + blocks["position"], v_TS_N=start.v_TS_N + blocks["velocity"], slow=slow,
        covariance=jnp.asarray(P),
    )  # fmt: skip
    box = replace(
        rendezvous_scene.box(flight, np.eye(3), np.array([0.0, 0.0, 30.0])),
        interval=jnp.zeros(()),
        attitude_variance_change=jnp.zeros(()),
    )
    tuning = replace(flight.navigation, adaptation_limit=jnp.asarray(limit))
    after, priors, ratio = jax.jit(lasting_adaptation.adapt)(tuning, known, lasting_adaptation.initial(start), box)
    return after, priors, float(ratio)


def test_what_is_as_declared_stays_to_rounding(flight: FlightParams, start: RelativeEstimate) -> None:
    after, priors, ratio = adapted(flight, start, 1.5 * SIGMA)
    np.testing.assert_array_equal(priors.adapted, priors.declared)
    mean, P = learnt(start, SIGMA, 1.5 * SIGMA)
    np.testing.assert_allclose(after.covariance, P, atol=1e-15)
    np.testing.assert_allclose(after.slow["burn_scale"], mean[PLACE], rtol=1e-12)
    assert 1.2 < ratio < 1.5


@pytest.mark.parametrize(("sigmas", "limit"), [(5.0, 6.0), (9.0, 6.0), (40.0, 6.0), (9.0, 1.0)])
def test_beyond_two_sigma_it_is_the_posterior_of_the_wider_prior(
    flight: FlightParams, start: RelativeEstimate, sigmas: float, limit: float
) -> None:
    after, priors, ratio = adapted(flight, start, sigmas * SIGMA, limit)
    wider = float(np.sqrt(np.max(priors.adapted / np.where(priors.declared > 0.0, priors.declared, np.inf))))
    assert wider == pytest.approx(min(sigmas / 2.0, limit), rel=0.02)
    mean, P = learnt(start, wider * SIGMA, sigmas * SIGMA)
    np.testing.assert_allclose(after.slow["burn_scale"], mean[PLACE], rtol=1e-9)
    np.testing.assert_allclose(after.r_TS_N - start.r_TS_N, mean[:3], rtol=1e-9, atol=1e-12)
    units = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    known = np.outer(np.diag(P) > 0.0, np.diag(P) > 0.0)
    np.testing.assert_allclose(np.where(known, after.covariance, 0.0) / np.where(known, units, 1.0),
                               np.where(known, P, 0.0) / np.where(known, units, 1.0), atol=1e-9)  # fmt: skip
    assert ratio == pytest.approx(sigmas, rel=0.05)


def test_the_bearing_bias_does_not_adapt_beside_lasting_errors_of_a_network(flight: FlightParams) -> None:
    alone = rendezvous_scene.estimate(flight).relative
    assert lasting_adaptation.initial(alone).declared.shape == (6,)
    states = relative_filter_state.states_with(["landmarks", "landmark_network"])
    beside = relative_filter_state.initial(flight.navigation, alone.r_TS_N, alone.v_TS_N, states)
    # Burn scale, two angles of the thrust and the difference of drag are left.
    assert lasting_adaptation.initial(beside).declared.shape == (4,)
