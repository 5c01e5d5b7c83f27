"""Burns that follow a reference, against integrated free motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from relative_motion_cases import ECCENTRICITIES, advanced, integrated_free_motion, orbit, period

from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.flight.guidance.references import impulsive_tracking
from rpojax.flight.guidance.references.impulsive_tracking import TrackedPoint


@jax.jit
def tracked_point(
    orbit: TargetOrbit, period: jax.Array, before: jax.Array, at: jax.Array, after: jax.Array
) -> TrackedPoint:
    """Tracked point of a burn at a place on the orbit."""
    times = jnp.stack([-period, 0.0 * period, period])
    orbits = jax.vmap(yamanaka_ankersen.advanced, in_axes=(None, 0))(orbit, times)
    return impulsive_tracking.tracked_point(orbits, period, jnp.stack([before, at, after]))


free_motion = jax.jit(yamanaka_ankersen.free_motion)
INTERVAL = jnp.asarray(200.0)


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_a_free_motion_needs_no_impulse(e: float) -> None:
    constants = jnp.array([30.0, -20.0, 50.0, 2.0, 7.0, 11.0])
    before, at, after = (
        np.asarray(free_motion(advanced(orbit(e), jnp.asarray(t)), jnp.asarray(t), constants))
        for t in (-200.0, 0.0, 200.0)
    )
    found = tracked_point(orbit(e), INTERVAL, *(jnp.asarray(x[:3]) for x in (before, at, after)))
    np.testing.assert_allclose(found.impulse, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.arrival_velocity, at[3:], atol=1e-12)


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_the_impulses_lead_from_point_to_point(e: float) -> None:
    points = np.array([[0.0, -100.0, 5.0], [3.0, -90.0, 4.0], [9.0, -70.0, 0.0], [9.0, -60.0, -8.0], [2.0, -50.0, 0.0]])
    places = [advanced(orbit(e), jnp.asarray(200.0 * k)) for k in range(5)]
    found = [tracked_point(places[k], INTERVAL, *(jnp.asarray(p) for p in points[k - 1 : k + 2])) for k in (1, 2, 3)]
    state = np.concatenate([points[1], found[0].arrival_velocity])
    for k, burn in zip((1, 2, 3), found, strict=True):
        np.testing.assert_allclose(state[3:], burn.arrival_velocity, atol=1e-8)
        state = integrated_free_motion(e, places[k], state + np.concatenate([np.zeros(3), burn.impulse]), 200.0)
        np.testing.assert_allclose(state[:3], points[k + 1], atol=1e-6)


@pytest.mark.parametrize("e", ECCENTRICITIES)
@pytest.mark.parametrize("place", [(30.0, 0.0, 0.0), (0.0, 0.0, -20.0), (10.0, -25.0, 15.0)])
def test_the_free_motion_returns_to_a_place_that_is_held(e: float, place: tuple[float, float, float]) -> None:
    position, at = jnp.array(place), orbit(e)
    station = tracked_point(at, INTERVAL, position, position, position)
    start = np.concatenate([place, np.asarray(station.arrival_velocity + station.impulse)])
    np.testing.assert_allclose(integrated_free_motion(e, at, start, 200.0)[:3], place, atol=1e-6)


def test_a_place_along_the_track_of_a_circular_orbit_needs_no_impulse() -> None:
    position = jnp.array([0.0, -30.0, 0.0])
    station = tracked_point(orbit(0.0), INTERVAL, position, position, position)
    np.testing.assert_allclose(station.arrival_velocity, 0.0, atol=1e-14)
    np.testing.assert_allclose(station.impulse, 0.0, atol=1e-14)


@pytest.mark.parametrize("turns", [0.5, 1.0, 2.0])
def test_periods_without_a_solution_give_bounded_impulses(turns: float) -> None:
    found = tracked_point(orbit(0.0), jnp.asarray(turns * period(0.0)), *jnp.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0],
                                                                                    [7.0, 8.0, 10.0]]))  # fmt: skip
    # The least divisor is that of straight motion over three times the angle.
    bound = 2.0 * np.hypot(1.0, 2.0 * np.pi * turns) / 0.3 * 100.0 / (turns * period(0.0))
    assert np.all(np.abs(np.asarray(found.impulse)) < bound)


def test_holding_a_place_across_the_track_near_half_an_orbit_takes_centimetres_and_does_not_flip() -> None:
    """10 m across the track; with a divisor that is cut off at a thousandth it took 3.6 m/s, up or down."""
    position = jnp.array([0.0, -50.0, 10.0])
    periods = jnp.asarray(period(0.0) * np.linspace(0.45, 0.55, 201))
    found = jax.vmap(lambda seconds: tracked_point(orbit(0.0), seconds, position, position, position))(periods)
    impulse = np.asarray(found.impulse)
    # To the other side and back, at 1/0.3 of the straight motion's speed for each radian.
    assert np.max(np.abs(impulse)) < 2.0 * 20.0 / (0.45 * period(0.0)) * np.hypot(1.0, 1.1 * np.pi) / 0.3
    assert np.max(np.abs(np.diff(impulse[:, 2]))) < 0.02
    slope = jax.grad(lambda seconds: tracked_point(orbit(0.0), seconds, position, position, position).impulse[2])
    assert np.isfinite(slope(jnp.asarray(0.5 * period(0.0))))
