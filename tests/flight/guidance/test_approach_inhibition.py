"""Approach inhibition: which burns are made, with and without confidence, and what replaces the others."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from numpy_reference import SEEDS
from scipy.linalg import expm

from rpojax.flight.guidance import approach_inhibition
from rpojax.flight.guidance.approach_inhibition import Approach, Confidence

N = 1.1e-3
PERIOD = 200.0
STATION = np.array([0.0, -30.0, 0.0])
HILL = np.zeros((6, 6))
HILL[:3, 3:] = np.eye(3)
HILL[3, 0], HILL[3, 4], HILL[4, 3], HILL[5, 2] = 3.0 * N**2, 2.0 * N, -2.0 * N, -(N**2)
inhibit = jax.jit(approach_inhibition.inhibit)


def change(
    state: np.ndarray,
    wanted: np.ndarray,
    confident: bool = True,
    visible: bool = True,
    sigma: float = 0.5,
    confident_range: float | None = None,
) -> np.ndarray:
    """Velocity change instead of the `wanted` one [m/s]; the confidence was lost at the present range by default."""
    confident_range = float(np.linalg.norm(state[:3])) if confident_range is None else confident_range
    approach = Approach(
        station_H=STATION, state_H=state, stays_visible=jnp.asarray(visible), n=np.float64(N), period=PERIOD
    )
    confidence = Confidence(
        present=jnp.asarray(confident), last_range=jnp.asarray(confident_range), range_sigma=np.float64(sigma)
    )
    return np.asarray(inhibit(np.float64(0.5), approach, confidence, wanted, np.float64(1.0)))


def least_range(state: np.ndarray, delta_v: np.ndarray, duration: float = 2.0 * PERIOD) -> float:
    """Least range over the free motion after a velocity change, by the matrix exponential of Hill's equations."""
    start = state + np.concatenate([np.zeros(3), delta_v])
    return min(float(np.linalg.norm((expm(HILL * t) @ start)[:3])) for t in np.linspace(duration / 24, duration, 24))


@given(SEEDS)
def test_with_confidence_a_burn_is_made_as_it_is_wherever_its_free_motion_stays_clear(seed: int) -> None:
    rng = np.random.default_rng(seed)
    state = np.concatenate([STATION + 8.0 * rng.normal(size=3), 0.02 * rng.normal(size=3)])
    wanted = 0.02 * rng.normal(size=3)
    found = change(state, wanted)
    bound = min(16.0, float(np.linalg.norm(state[:3])))
    if least_range(state, wanted) >= bound:
        np.testing.assert_array_equal(found, wanted)
    else:
        assert least_range(state, found) >= min(bound - 1e-9, least_range(state, wanted))


@pytest.mark.parametrize("begin", [40.0, 14.0])
def test_small_burns_towards_a_station_behind_the_target_do_not_add_up_to_an_approach(begin: float) -> None:
    state = np.array([0.0, begin, 0.0, 0.0, 0.0, 0.0])
    moved, ranges = expm(HILL * PERIOD), []
    for _ in range(60):
        # The velocity that leads to the station in a thousand seconds.
        burn = change(state, np.array([0.0, (STATION[1] - state[1]) / 1000.0, 0.0]) - state[3:])
        ranges.append(least_range(state, burn, PERIOD))
        state = moved @ (state + np.concatenate([np.zeros(3), burn]))
    assert min(ranges) >= min(begin, 16.0) - 1e-9


@given(SEEDS)
def test_without_confidence_no_burn_comes_nearer_where_another_stays_away(seed: int) -> None:
    rng = np.random.default_rng(seed)
    state = np.concatenate([STATION * rng.uniform(0.4, 2.0) + rng.normal(size=3), 0.01 * rng.normal(size=3)])
    wanted = 0.05 * rng.normal(size=3)
    found = change(state, wanted, confident=False)
    bound = float(np.linalg.norm(state[:3]))
    assert least_range(state, found) >= min(bound, least_range(state, np.zeros(3))) - 1e-9


def test_without_confidence_the_servicer_does_not_approach() -> None:
    far = np.array([0.0, -50.0, 0.0, 0.0, 0.0, 0.0])
    approach = np.array([0.0, 0.05, 0.0])
    np.testing.assert_array_equal(change(far, approach), approach)
    assert least_range(far, approach) < 35.0
    assert least_range(far, change(far, approach, confident=False)) >= 50.0


@pytest.mark.parametrize("scale", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("x", [-6.0, 0.0, 6.0])
def test_without_confidence_the_servicer_holds_even_if_the_range_is_believed_far_from_what_it_is(
    scale: float, x: float
) -> None:
    state = np.array([x, -50.0, 2.0, 0.005, -0.01, 0.005])
    begin = float(np.linalg.norm(state[:3]))
    moved, ranges = expm(HILL * PERIOD), []
    for _ in range(60):
        burn = change(scale * state, np.zeros(3), confident=False, confident_range=scale * begin)
        ranges.append(least_range(state, burn, PERIOD))
        state = moved @ (state + np.concatenate([np.zeros(3), burn]))
    assert min(ranges) > begin
    assert max(ranges) < 1.2 * begin
    np.testing.assert_allclose(ranges[-10:], 1.1 * begin, rtol=0.03)


def test_without_confidence_a_hold_does_not_return_to_the_range_at_which_it_was_lost() -> None:
    far = np.array([0.0, -80.0, 0.0, 0.0, 0.0, 0.0])
    found = change(far, np.array([0.0, 0.02, 0.0]), confident=False, confident_range=50.0)
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


def test_the_last_burn_in_the_light_stops_the_drift() -> None:
    state = np.array([3.0, -35.0, 1.0, 0.01, 0.02, -0.005])
    found = change(state, np.array([0.0, 0.05, 0.0]), visible=False)
    after = state[3:] + found
    np.testing.assert_allclose(after, [0.0, -2.0 * N * state[0], 0.0], atol=1e-15)
    # No drift: the free motion returns after an orbit.
    returned = least_range(np.concatenate([state[:3], after]), np.zeros(3), 2.0 * np.pi / N)
    assert returned > 25.0


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_change_that_is_not_finite_is_not_hidden(value: float) -> None:
    state = np.array([0.0, -50.0, 0.0, 0.0, 0.0, 0.0])
    assert not np.all(np.isfinite(change(state, np.array([0.0, value, 0.0]), confident=False)))
