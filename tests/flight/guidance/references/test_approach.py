"""Approaches and retreats: speeds against their profile, integrated."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from relative_motion_cases import advanced, entry, orbit
from scipy.integrate import solve_ivp

from rpojax.flight.guidance.references import approach, retreat
from rpojax.flight.guidance.references.approach import Approach
from rpojax.flight.guidance.references.retreat import Retreat

approach_state, retreat_state = jax.jit(approach.state), jax.jit(retreat.state)
retreat_end = jax.jit(retreat.end_position)
END = np.array([0.0, -12.0, 1.0])
MAX_SPEED, TIME_CONSTANT, FINAL_SPEED = 0.1, 300.0, 0.02


def approaching(start: np.ndarray, elapsed: float) -> np.ndarray:
    reference = Approach(
        end_position=jnp.asarray(END),
        max_speed=jnp.asarray(MAX_SPEED),
        time_constant=jnp.asarray(TIME_CONSTANT),
        final_speed=jnp.asarray(FINAL_SPEED),
    )
    seconds = jnp.asarray(elapsed)
    at = advanced(orbit(0.1), seconds)
    return np.asarray(approach_state(reference, entry(*start, 0.0, 0.0, 0.0), at, seconds))


@pytest.mark.parametrize("distance", [90.0, 20.0, 4.0])
def test_the_speed_is_that_of_the_profile_at_every_distance(distance: float) -> None:
    direction = np.array([0.3, -1.0, 0.2]) / np.linalg.norm([0.3, -1.0, 0.2])

    def rate(_: float, remaining: np.ndarray) -> np.ndarray:
        return -np.clip(remaining / TIME_CONSTANT, FINAL_SPEED, MAX_SPEED)

    times = np.linspace(0.0, distance / MAX_SPEED, 9)
    expected = solve_ivp(rate, (0.0, times[-1]), [distance], t_eval=times, rtol=1e-10, atol=1e-10, max_step=1.0).y[0]
    for elapsed, remaining in zip(times, expected, strict=True):
        found = approaching(END + distance * direction, elapsed)
        remaining = max(remaining, 0.0)
        np.testing.assert_allclose(found[:3], END + remaining * direction, atol=1e-5)
        if remaining > 0.0:
            speed = np.clip(remaining / TIME_CONSTANT, FINAL_SPEED, MAX_SPEED)
            np.testing.assert_allclose(found[3:], -speed * direction, atol=1e-7)


def test_it_arrives_when_the_three_parts_of_the_profile_are_over() -> None:
    """From 90 m: 60 m at 0.1 m/s, from 30 m to 6 m exponentially, 6 m at 0.02 m/s."""
    end = 600.0 + TIME_CONSTANT * np.log(5.0) + 300.0
    start = END - np.array([0.0, 90.0, 0.0])
    np.testing.assert_allclose(approaching(start, end - 10.0), [0.0, -12.2, 1.0, 0.0, 0.02, 0.0], atol=1e-9)
    np.testing.assert_allclose(approaching(start, end + 10.0), [*END, 0.0, 0.0, 0.0], atol=1e-9)


def retreating(start: list[float], elapsed: float) -> np.ndarray:
    reference = Retreat(distance=jnp.asarray(500.0), speed=jnp.asarray(0.2))
    seconds = jnp.asarray(elapsed)
    at = advanced(orbit(0.1), seconds)
    return np.asarray(retreat_state(reference, entry(*start, 0.0, 0.0, 0.0), at, seconds))


def test_a_retreat_leads_straight_away_at_its_speed_and_stops() -> None:
    direction = np.array([0.6, 0.0, 0.8])
    start = list(20.0 * direction)
    before, after = retreating(start, 1000.0), retreating(start, 1500.0)
    np.testing.assert_allclose((after - before)[:3], 100.0 * direction, atol=1e-2)
    np.testing.assert_allclose(after[3:], 0.2 * direction, atol=1e-5)
    np.testing.assert_allclose(retreating(start, 5000.0), [*500.0 * direction, 0.0, 0.0, 0.0], atol=1e-9)


def test_a_retreat_starts_from_rest_and_only_gains_distance() -> None:
    distances = [np.linalg.norm(retreating([0.0, -30.0, 0.0], elapsed)[:3]) for elapsed in np.linspace(0.0, 4e3, 41)]
    assert np.all(np.diff(distances) >= 0.0)
    np.testing.assert_allclose(retreating([0.0, -30.0, 0.0], 0.0), [0.0, -30.0, 0.0, 0.0, 0.0, 0.0], atol=1e-12)


def test_a_servicer_beyond_the_distance_stays() -> None:
    np.testing.assert_allclose(retreating([0.0, 600.0, 0.0], 100.0), [0.0, 600.0, 0.0, 0.0, 0.0, 0.0])
    reference = Retreat(distance=jnp.asarray(500.0), speed=jnp.asarray(0.2))
    np.testing.assert_allclose(retreat_end(reference, entry(0.0, 600.0, 0.0, 0.0, 0.0, 0.0)), [0.0, 600.0, 0.0])
