"""Closest approach of motions whose distance is known."""

import jax
import numpy as np
import pytest

from rpojax.core.orbits import closest_approach as module

closest_approach = jax.jit(module.closest_approach)
least_square_until = jax.jit(module.least_square_until)
entry_place = jax.jit(module.entry_place)

SPEED = np.array([0.0, 0.2, 0.0])


def passing(miss: float, begin: float, duration: float) -> module.Approach:
    """Straight passage at a distance `miss` [m], from `begin` [m] before it."""
    r = np.array([[miss, -begin, 0.0], [miss, -begin + SPEED[1] * duration, 0.0]])
    return closest_approach(r, np.stack([SPEED, SPEED]), duration)


@pytest.mark.parametrize("miss", [0.0, 0.3, 25.0])
def test_a_straight_passage_has_the_distance_of_the_line(miss: float) -> None:
    found = passing(miss, 9.0, 120.0)
    np.testing.assert_allclose(found.least, miss**2, atol=1e-12)
    np.testing.assert_allclose(found.place, 9.0 / 24.0, atol=1e-9)


def test_motion_that_recedes_or_approaches_throughout_is_closest_at_an_end() -> None:
    assert (float(passing(3.0, -5.0, 60.0).place), float(passing(3.0, 50.0, 60.0).place)) == (0.0, 1.0)
    np.testing.assert_allclose(passing(3.0, -5.0, 60.0).least, 34.0)
    np.testing.assert_allclose(passing(3.0, 50.0, 60.0).least, 9.0 + 38.0**2)


def test_an_interval_of_no_length_has_the_distance_of_its_place() -> None:
    assert float(passing(3.0, 4.0, 0.0).least) == 25.0


def test_the_least_distance_until_a_time_before_the_closest_approach_is_that_of_this_time() -> None:
    found = passing(3.0, 9.0, 120.0)
    np.testing.assert_allclose(least_square_until(found, 0.25), 9.0 + 3.0**2, rtol=1e-12)
    np.testing.assert_allclose(least_square_until(found, 0.5), 9.0, rtol=1e-12)


def test_the_sphere_is_entered_where_the_line_crosses_it() -> None:
    found = passing(3.0, 9.0, 120.0)
    np.testing.assert_allclose(entry_place(found, 5.0), 5.0 / 24.0, rtol=1e-9)
    assert float(entry_place(found, 2.9)) == np.inf


def test_a_passage_on_a_circle_is_found_between_two_times() -> None:
    """The relative motion of an orbit: the error of the interpolation is of fourth order in the angle."""
    angle, radius = 0.2, 100.0
    centre = np.array([110.0, 0.0, 0.0])
    phases = np.array([-0.06, -0.06 + angle])
    r = centre + radius * np.stack([-np.cos(phases), np.sin(phases), 0.0 * phases], axis=1)
    v = radius * np.stack([np.sin(phases), np.cos(phases), 0.0 * phases], axis=1)
    found = closest_approach(r, v, angle)
    np.testing.assert_allclose(np.sqrt(found.least), 10.0, atol=radius * angle**4 / 384.0)
    np.testing.assert_allclose(found.place, 0.3, atol=1e-3)


def test_curved_passages_have_the_least_distance_of_their_cubic_by_fine_samples() -> None:
    rng = np.random.default_rng(3)
    count, duration, places = 1000, 120.0, np.linspace(0.0, 1.0, 2001)
    # Passages within the interval, which curve by a seventh of their way.
    speed, curve, twist = (size * rng.normal(size=(count, 3)) for size in (1.0, 0.1, 0.05))
    speed /= np.linalg.norm(speed, axis=1)[:, None]
    start = 0.5 * rng.normal(size=(count, 3)) - rng.uniform(0.0, 1.0, (count, 1)) * speed
    powers = places[None, :, None] ** np.arange(4)[:, None, None]
    path = start[:, None] + speed[:, None] * powers[1] + curve[:, None] * powers[2] + twist[:, None] * powers[3]
    distance = np.linalg.norm(path, axis=2)
    falling = np.diff(distance, axis=1) < 0.0
    one_minimum = np.all(falling[:, :-1] >= falling[:, 1:], axis=1)
    assert one_minimum.mean() > 0.8

    r = np.stack([start, path[:, -1]], axis=1)
    v = np.stack([speed, speed + 2.0 * curve + 3.0 * twist], axis=1) / duration
    found = jax.jit(jax.vmap(module.closest_approach, in_axes=(0, 0, None)))(r, v, duration)
    squares = np.asarray(found.squares) @ places[None, :] ** np.arange(7)[:, None]
    np.testing.assert_allclose(squares, distance**2, atol=1e-9)
    least = distance.min(axis=1)
    np.testing.assert_allclose(np.sqrt(found.least)[one_minimum], least[one_minimum], rtol=0.0, atol=1e-4)
    at = places[distance.argmin(axis=1)]
    np.testing.assert_allclose(found.place[one_minimum], at[one_minimum], rtol=0.0, atol=2e-2)
    until = jax.jit(jax.vmap(module.least_square_until, in_axes=(0, None)))
    for number in (200, 1000, 1800):
        expected = distance[:, : number + 1].min(axis=1)
        np.testing.assert_allclose(
            np.sqrt(until(found, places[number]))[one_minimum], expected[one_minimum], rtol=0.0, atol=1e-4
        )
