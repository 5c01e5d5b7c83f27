"""Burns that follow a reference, against integrated free motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from relative_motion_cases import ECCENTRICITIES, advanced, integrated_free_motion, orbit, period

from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import replace
from rpojax.flight.control.station_keeping import solve_station_keeping
from rpojax.flight.guidance.references import impulsive_tracking
from rpojax.scenario.params import Params

tracked_point = jax.jit(impulsive_tracking.tracked_point)
free_motion = jax.jit(yamanaka_ankersen.free_motion)
INTERVAL = jnp.asarray(200.0)


def resting(position: np.ndarray | jax.Array) -> jax.Array:
    """State (6,) at rest."""
    return jnp.concatenate([jnp.asarray(position), jnp.zeros(3)])


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_a_free_motion_needs_no_impulse(e: float) -> None:
    constants = jnp.array([30.0, -20.0, 50.0, 2.0, 7.0, 11.0])
    before, at, after = (
        np.asarray(free_motion(advanced(orbit(e), jnp.asarray(t)), jnp.asarray(t), constants))
        for t in (-200.0, 0.0, 200.0)
    )
    found = tracked_point(orbit(e), INTERVAL, *map(jnp.asarray, (before, at, after)))
    np.testing.assert_allclose(found.impulse, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.arrival_velocity, at[3:], atol=1e-12)


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_the_impulses_lead_from_point_to_point(e: float) -> None:
    points = np.array([[0.0, -100.0, 5.0], [3.0, -90.0, 4.0], [9.0, -70.0, 0.0], [9.0, -60.0, -8.0], [2.0, -50.0, 0.0]])
    places = [advanced(orbit(e), jnp.asarray(200.0 * k)) for k in range(5)]
    found = [tracked_point(places[k], INTERVAL, *map(resting, points[k - 1 : k + 2])) for k in (1, 2, 3)]
    state = np.concatenate([points[1], found[0].arrival_velocity])
    for k, burn in zip((1, 2, 3), found, strict=True):
        np.testing.assert_allclose(state[3:], burn.arrival_velocity, atol=1e-8)
        state = integrated_free_motion(e, places[k], state + np.concatenate([np.zeros(3), burn.impulse]), 200.0)
        np.testing.assert_allclose(state[:3], points[k + 1], atol=1e-6)


def test_holding_a_place_on_a_circular_orbit_is_station_keeping(params: Params) -> None:
    position = jnp.array([10.0, -25.0, 15.0])
    at = orbit(0.0)
    expected = solve_station_keeping(
        replace(params.flight.formation, desired_position=position), mean_motion(at.semi_major_axis), 200.0
    )
    found = tracked_point(at, INTERVAL, *3 * [resting(position)])
    np.testing.assert_allclose(found.impulse, expected.impulse, atol=1e-13)
    np.testing.assert_allclose(found.arrival_velocity, expected.arrival_velocity, atol=1e-13)


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_at_regular_periods_velocities_do_not_count(e: float) -> None:
    points = np.array([[0.0, -100.0, 5.0], [3.0, -90.0, 4.0], [9.0, -70.0, 0.0]])
    moving = [jnp.asarray([*each, 0.3, -0.1, 0.2]) for each in points]
    for other in (map(resting, points), moving):
        found = tracked_point(orbit(e), INTERVAL, *other)
        expected = tracked_point(orbit(e), INTERVAL, *map(resting, points))
        np.testing.assert_array_equal(found.impulse, expected.impulse)
        np.testing.assert_array_equal(found.arrival_velocity, expected.arrival_velocity)


SINGULAR_TURNS = [0.49, 0.4998, 0.5, 0.5002, 0.51, 0.995, 1.0, 1.405, 1.5, 2.0]


@pytest.mark.parametrize("turns", SINGULAR_TURNS)
def test_a_free_motion_needs_no_impulse_at_singular_periods_either(turns: float) -> None:
    constants, dt = jnp.array([30.0, -20.0, 50.0, 0.0, 7.0, 11.0]), turns * period(0.0)
    states = [free_motion(advanced(orbit(0.0), jnp.asarray(t)), jnp.asarray(t), constants) for t in (-dt, 0.0, dt)]
    found = tracked_point(orbit(0.0), jnp.asarray(dt), *states)
    np.testing.assert_allclose(found.impulse, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.arrival_velocity, states[1][3:], atol=1e-9)


@pytest.mark.parametrize("turns", SINGULAR_TURNS)
def test_holding_a_place_takes_no_more_at_singular_periods_than_at_regular_ones(turns: float) -> None:
    """Half an orbit less 24 deg, the last regular period, takes 2 n z (1 + cos 24 deg) / sin 24 deg, 9.4 n z = 0.1 m/s.

    Two impulses take 3.6 m/s near half an orbit, of either sign.
    """
    n = 2.0 * np.pi / period(0.0)
    for place in ([0.0, -30.0, 10.0], [0.0, -30.0, -10.0], [10.0, -30.0, 0.0]):
        found = tracked_point(orbit(0.0), jnp.asarray(turns * period(0.0)), *3 * [resting(np.array(place))])
        assert np.linalg.norm(found.impulse) < 9.5 * n * 10.0


def test_a_place_above_the_track_is_held_over_whole_orbits_by_the_closed_ellipse_through_it() -> None:
    """It has y_dot = -2 n x, at which no burn is needed."""
    n = 2.0 * np.pi / period(0.0)
    found = tracked_point(orbit(0.0), jnp.asarray(period(0.0)), *3 * [resting(np.array([10.0, 0.0, 0.0]))])
    np.testing.assert_allclose(found.arrival_velocity, [0.0, -20.0 * n, 0.0], atol=0.4 * n)
    np.testing.assert_allclose(found.impulse, 0.0, atol=0.4 * n)


@pytest.mark.parametrize("e", [0.0, 0.7])
def test_impulses_are_continuous_over_the_periods_between_burns(e: float) -> None:
    """From a quarter of an orbit to two, a thousandth apart: no jump and no change of sign by a pole."""
    n = 2.0 * np.pi / period(e)
    states = [
        jnp.array([*place, *(0.01 * np.ones(3))]) for place in ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 10.0])
    ]
    periods = jnp.asarray(period(e) * np.arange(0.25, 2.0, 0.001))
    found = jax.vmap(lambda each: impulsive_tracking.tracked_point(orbit(e), each, *states).impulse)(periods)
    steps = np.linalg.norm(np.diff(np.asarray(found), axis=0), axis=1)
    assert np.max(np.linalg.norm(found, axis=1)) < {0.0: 80.0, 0.7: 200.0}[e] * n
    assert np.max(steps) < {0.0: 3.0, 0.7: 12.0}[e] * n


@pytest.mark.parametrize("turns", SINGULAR_TURNS)
def test_derivatives_at_singular_periods_are_finite(turns: float) -> None:
    def total(at: TargetOrbit, dt: jax.Array, state: jax.Array) -> jax.Array:
        return jnp.sum(impulsive_tracking.tracked_point(at, dt, state, 0.9 * state, 0.8 * state).impulse)

    slopes = jax.jit(jax.grad(total, argnums=(0, 1, 2)))(orbit(0.0), jnp.asarray(turns * period(0.0)), jnp.ones(6))
    assert all(bool(jnp.all(jnp.isfinite(each))) for each in jax.tree.leaves(slopes))
