"""Sides of the target that a team has seen, by angles in numpy."""

import jax
import jax.numpy as jnp
import numpy as np
from numpy_reference import unit

from rpojax.core.pytree import replace
from rpojax.flight.team_guidance import direction_map
from rpojax.flight.team_guidance.direction_map import COUNT, DIRECTIONS
from rpojax.flight.team_guidance.team_situation import TeamTuning

VIEW, SUN = np.deg2rad(50.0), np.deg2rad(70.0)
UNUSED = jnp.zeros(())
TUNING = TeamTuning(
    keep_out=UNUSED,
    lost_after=UNUSED,
    phase_rate=UNUSED,
    view_incidence=jnp.asarray(VIEW),
    view_sun_incidence=jnp.asarray(SUN),
    view_memory=jnp.asarray(500.0),
    keeping_delta_v=UNUSED,
)
PLACES = np.array([[30.0, 10.0, -20.0], [-5.0, 50.0, 0.0]])
SUN_H = 1.5e11 * unit(np.array([0.4, 0.6, 0.3]))


def seen_from(place: np.ndarray) -> np.ndarray:
    """Sides within both angles, by the arc cosine."""
    towards, lit = (np.arccos(np.clip(DIRECTIONS.T @ unit(to), -1.0, 1.0)) for to in (place, SUN_H))
    return (towards <= VIEW) & (lit <= SUN)


def test_the_directions_are_spread_evenly_over_the_sphere() -> None:
    np.testing.assert_allclose(np.linalg.norm(DIRECTIONS, axis=0), 1.0, rtol=1e-14)
    np.testing.assert_allclose(DIRECTIONS @ DIRECTIONS.T / COUNT, np.eye(3) / 3.0, atol=0.01)
    np.testing.assert_allclose(DIRECTIONS.mean(axis=1), 0.0, atol=0.01)
    nearest = np.sort(DIRECTIONS.T @ DIRECTIONS, axis=1)[:, -2]
    # A hexagon of the same area is 21.8 deg wide.
    assert np.all(np.rad2deg(np.arccos(nearest)) > 15.0)
    assert np.all(np.rad2deg(np.arccos(nearest)) < 22.0)


def test_a_side_is_seen_within_the_incidence_of_view_and_sunlight() -> None:
    suns = np.tile(SUN_H[:, None], 2)
    found = np.asarray(jax.jit(direction_map.is_seen)(TUNING, jnp.asarray(PLACES.T), jnp.asarray(suns)))
    expected = np.stack([seen_from(place) for place in PLACES], axis=1)
    assert np.all(expected.any(axis=0))
    np.testing.assert_array_equal(found, expected)
    # With light from all sides that is the area of a cap, to two of the hundred directions.
    bright = replace(TUNING, view_sun_incidence=jnp.asarray(np.pi))
    share = np.mean(direction_map.is_seen(bright, jnp.asarray(PLACES.T), jnp.asarray(suns)), axis=0)
    np.testing.assert_allclose(share, 0.5 * (1.0 - np.cos(VIEW)), atol=2.0 / COUNT)


def test_only_those_that_see_the_target_make_sides_seen() -> None:
    for sees in ([True, False], [False, True], [True, True], [False, False]):
        found = direction_map.seen_by_any(TUNING, jnp.asarray(PLACES.T), jnp.array(sees), jnp.asarray(SUN_H))
        expected = [seen_from(place) for place, one_sees in zip(PLACES, sees, strict=True) if one_sees]
        np.testing.assert_array_equal(found, np.any([np.zeros(COUNT, dtype=bool), *expected], axis=0))


def test_a_side_is_worth_more_the_longer_it_was_not_seen() -> None:
    last_seen = jnp.array([100.0, 600.0, 1100.0, -jnp.inf])
    found = direction_map.worth(TUNING, last_seen, jnp.asarray(1100.0))
    np.testing.assert_allclose(found, [1.0 - np.exp(-2.0), 1.0 - np.exp(-1.0), 0.0, 1.0], rtol=1e-12)
    np.testing.assert_array_equal(direction_map.worth(TUNING, direction_map.unseen(jnp.zeros(())), jnp.zeros(())), 1.0)
