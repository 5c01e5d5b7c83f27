"""Late measurements in the filter: the state at the exposure, and updates there, against filters without delay."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import rendezvous_scene
from numpy_reference import random_covariance

from rpojax import nominal_parameters
from rpojax.core import kalman_update, quaternion
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.pytree import replace
from rpojax.flight.navigation import relative_filter_state, retrodiction
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.retrodiction import Exposure, History
from rpojax.scenario.loading import scenario_loader

TICK_S = 0.5
RATE = np.array([0.01, -0.02, 0.015])
DELTA_V = np.array([[0.0, 0.02, 0.01], [0.03, 0.0, 0.0], [-0.01, 0.005, 0.02]])
"""Velocity changes of the last ticks, the latest first [m/s]."""


@functools.cache
def estimate() -> RelativeEstimate:
    with jax.ensure_compile_time_eval():
        params = nominal_parameters(scenario_loader.load("inspection"))[1]
        known = rendezvous_scene.estimate(params.flight).relative
        P = random_covariance(np.random.default_rng(3), np.full(known.layout.size, 0.1))
        return replace(known, covariance=jnp.asarray(P))


def history() -> History:
    now = jnp.array([1.0, 0.0, 0.0, 0.0])
    # Every other quaternion with the other sign, as filters may give them.
    past = [(-1.0) ** k * quaternion.propagate(now, jnp.asarray(RATE), -k * TICK_S) for k in (1, 2, 3)]
    return History(q_BN=jnp.stack(past), delta_v_N=jnp.asarray(DELTA_V))


def test_exposure_retraces_a_motion_with_burns() -> None:
    now = jnp.array([1.0, 0.0, 0.0, 0.0])
    for age in (0.0, 0.2, 0.5, 1.1, 1.5):
        at = retrodiction.exposure(history(), now, jnp.asarray(age), TICK_S)
        then = retrodiction.to_exposure(estimate(), at)
        # Fine steps backwards: the servicer's acceleration is the velocity change over its tick.
        r, v = np.array(estimate().r_TS_N), np.array(estimate().v_TS_N)
        for k in range(round(age / 1e-3)):
            acceleration = -DELTA_V[int((k + 0.5) * 1e-3 / TICK_S)] / TICK_S
            r, v = r - (v - 0.5e-3 * acceleration) * 1e-3, v - 1e-3 * acceleration
        np.testing.assert_allclose(then.r_TS_N, r, atol=1e-9)
        np.testing.assert_allclose(then.v_TS_N, v, atol=1e-9)
        expected = quaternion.propagate(now, jnp.asarray(RATE), -age)
        assert abs(float(jnp.sum(at.q_BN * expected))) > 1.0 - 1e-10


def test_an_exposure_older_than_the_history_counts_as_its_oldest() -> None:
    oldest = retrodiction.exposure(history(), jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.asarray(9.0), TICK_S)
    np.testing.assert_allclose(oldest.age, 3 * TICK_S)


def test_forth_and_back_is_the_same_estimate() -> None:
    at = retrodiction.exposure(history(), jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.asarray(1.2), TICK_S)
    back = retrodiction.from_exposure(retrodiction.to_exposure(estimate(), at), at)
    for name in ("r_TS_N", "v_TS_N", "covariance"):
        np.testing.assert_allclose(getattr(back, name), getattr(estimate(), name), rtol=1e-12, atol=1e-13)
    assert retrodiction.to_exposure(estimate(), None) is estimate()


def _measured(of: RelativeEstimate, value: float) -> RelativeEstimate:
    """Estimate after a position along x with a noise of 0.2 m."""
    row = of.layout.rows(position=jnp.array([[1.0, 0.0, 0.0]]))
    rows = MeasurementRows(residual=value - of.r_TS_N[:1], jacobian=row, variance=jnp.array([0.04]), weight=jnp.ones(1))
    result = kalman_update.update(of.covariance, rows)
    return relative_filter_state.corrected(of, result.deviation, result.covariance)


def _moved(of: RelativeEstimate, delta_v: np.ndarray, dt: float) -> RelativeEstimate:
    """Estimate after a straight motion with a velocity change spread over it, and no process noise."""
    F = np.eye(of.layout.size)
    F[:3, 3:6] = dt * np.eye(3)
    return replace(
        of,
        r_TS_N=of.r_TS_N + dt * of.v_TS_N - 0.5 * dt * delta_v,
        v_TS_N=of.v_TS_N - delta_v,
        covariance=jnp.asarray(F @ np.array(of.covariance) @ F.T),
    )


def test_measurements_out_of_order_give_the_filter_that_had_them_in_order() -> None:
    start = estimate()
    x = float(start.r_TS_N[0])
    # In order: one a tick, at the begin of each of three.
    in_order = start
    for value, delta_v in zip((x + 0.1, x - 0.2, x + 0.3), DELTA_V[::-1], strict=True):
        in_order = _moved(_measured(in_order, value), delta_v, TICK_S)
    # Out of order: all at the end, the second before the first.
    late = start
    for delta_v in DELTA_V[::-1]:
        late = _moved(late, delta_v, TICK_S)
    for value, age in ((x - 0.2, 2), (x + 0.1, 3), (x + 0.3, 1)):
        at = retrodiction.exposure(history(), jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.asarray(age * TICK_S), TICK_S)
        late = retrodiction.from_exposure(_measured(retrodiction.to_exposure(late, at), value), at)
    np.testing.assert_allclose(late.vector, in_order.vector, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(late.covariance, in_order.covariance, rtol=1e-8, atol=1e-12)


def test_the_exposure_has_a_derivative_to_its_age() -> None:
    def position(age: jax.Array) -> jax.Array:
        at: Exposure = retrodiction.exposure(history(), jnp.array([1.0, 0.0, 0.0, 0.0]), age, TICK_S)
        return retrodiction.to_exposure(estimate(), at).r_TS_N

    slope, step = jax.jacfwd(position)(jnp.asarray(0.7)), 1e-6
    difference = (position(jnp.asarray(0.7 + step)) - position(jnp.asarray(0.7 - step))) / (2 * step)
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-8)
