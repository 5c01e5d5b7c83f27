"""Fly-arounds: circles by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from relative_motion_cases import advanced, entry, orbit, period

from rpojax.core.pytree import replace
from rpojax.flight.guidance.references import fly_around
from rpojax.flight.guidance.references.fly_around import FlyAround
from rpojax.flight.guidance.references.phase_entry import PhaseEntry

state = jax.jit(fly_around.state)
AT = orbit(0.0)
RATE = np.deg2rad(90.0) / 600.0


def circle(axis: list[float], rate: float, join: float, start: float | None) -> FlyAround:
    """Circle of 40 m."""
    given = None if start is None else jnp.asarray(start)
    radius, normal, turning, joining = map(jnp.asarray, (40.0, axis, rate, join))
    return FlyAround(radius=radius, axis=normal, rate=turning, join=joining, start=given)


def position(axis: list[float], elapsed: float, start: float | None, *at_entry: float) -> np.ndarray:
    seconds = jnp.asarray(elapsed)
    reference = circle(axis, RATE, 0.0, start)
    found = state(reference, entry(*at_entry, 0.0, 0.0, 0.0), advanced(orbit(0.1), seconds), seconds)
    return np.asarray(found)[:3]


@jax.jit
def ways(reference: FlyAround, starts: jax.Array, times: jax.Array) -> jax.Array:
    """States (s, t, 6) of the ways from starts (s, 6) on a circular orbit."""

    def one(start: jax.Array, elapsed: jax.Array) -> jax.Array:
        return fly_around.state(reference, PhaseEntry(relative_state=start, orbit=AT), AT, elapsed)

    return jax.vmap(jax.vmap(one, in_axes=(None, 0)), in_axes=(0, None))(starts, times)


def test_a_quarter_turn_about_the_orbit_normal_leads_from_behind_to_above_to_ahead() -> None:
    """Right-handed about +z: from -y to +x."""
    axis = [0.0, 0.0, 3.0]
    np.testing.assert_allclose(position(axis, 0.0, None, 0.0, -70.0, 5.0), [0.0, -40.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(position(axis, 600.0, None, 0.0, -70.0, 5.0), [40.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(position(axis, 1200.0, None, 0.0, -70.0, 5.0), [0.0, 40.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("axis", "expected"),
    [([0.0, 0.0, 1.0], [0.0, 40.0, 0.0]), ([-1.0, 0.0, 0.0], [0.0, 40.0, 0.0]), ([0.0, 1.0, 0.0], [40.0, 0.0, 0.0])],
)
def test_a_given_start_counts_from_along_track_or_else_from_the_radial_direction(
    axis: list[float], expected: list[float]
) -> None:
    np.testing.assert_allclose(position(axis, 0.0, 0.0, 3.0, 7.0, 11.0), expected, atol=1e-12)
    quarter = position(axis, 0.0, np.pi / 2.0, 3.0, 7.0, 11.0)
    np.testing.assert_allclose(quarter, np.cross(axis, expected), atol=1e-12)


def test_an_inclined_circle_keeps_its_radius_and_plane() -> None:
    axis = [1.0, 2.0, -1.0]
    for elapsed in np.linspace(0.0, 2400.0, 7):
        found = position(axis, elapsed, None, 10.0, -50.0, 3.0)
        np.testing.assert_allclose([np.linalg.norm(found), found @ np.array(axis)], [40.0, 0.0], atol=1e-11)


def test_a_servicer_on_the_axis_starts_at_the_zero_angle() -> None:
    np.testing.assert_allclose(position([0.0, 0.0, 1.0], 0.0, None, 0.0, 0.0, 50.0), [0.0, 40.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("start", [None, 0.0, np.pi / 2.0])
def test_an_angle_near_the_axis_is_not_one_of_noise(start: float | None) -> None:
    """A millimetre beside the axis, to any side, all ways are within some millimetres; of 40 m two metres are near."""
    for beside in (1e-3, 1.9):
        turns = np.linspace(0.0, 2.0 * np.pi, 9)
        sides = np.stack([beside * np.cos(turns), beside * np.sin(turns)] + [np.full(9, 50.0)] + 3 * [np.zeros(9)], 1)
        found = np.asarray(ways(circle([0.0, 0.0, 2.0], RATE, 900.0, start), jnp.asarray(sides), jnp.arange(0.0, 1e3)))
        assert np.max(np.ptp(found[..., :3], axis=0)) < 2.0 * beside + 1e-9
    far = entry(-2.1, 0.0, 50.0, 0.0, 0.0, 0.0)
    found = state(circle([0.0, 0.0, 2.0], RATE, 0.0, None), far, AT, jnp.asarray(0.0))
    np.testing.assert_allclose(found[:3], [-40.0, 0.0, 0.0], atol=1e-12)


AT_REST = {
    "radial": [20.0, 0.0, 0.0],
    "behind": [0.0, -70.0, 0.0],
    "beside": [3.0, 5.0, -55.0],
    "on the circle": [0.0, -40.0, 0.0],
    "between": [25.0, -25.0, 15.0],
}


@pytest.mark.parametrize("start", [None, 0.0, np.pi / 2.0])
@pytest.mark.parametrize("axis", [[0.0, 0.0, 1.0], [1.0, 0.0, -0.7], [0.0, 1.0, 0.0]])
@pytest.mark.parametrize("turns", [0.0, 0.5, -1.0])
def test_a_join_of_an_orbit_keeps_between_the_distances_of_entry_and_circle(
    axis: list[float], turns: float, start: float | None
) -> None:
    """Free motion from rest 20 m above leads 377 m along the track in an orbit, and half a turn past the target.

    Velocities at the entry take another tenth of the lesser distance at most.
    """
    join = period(0.0)
    reference = circle(axis, 2.0 * np.pi * turns / join, join, start)
    places = np.array(list(AT_REST.values()))
    distances = np.linalg.norm(places, axis=1)
    times = jnp.linspace(0.0, join, 301)
    lesser, greater = np.minimum(distances, 40.0), np.maximum(distances, 40.0)
    for velocity in ([0.0, 0.0, 0.0], [0.1, 0.05, -0.2], [0.0, -0.03, 0.02]):
        starts = np.concatenate([places, np.broadcast_to(velocity, places.shape)], axis=1)
        found = np.asarray(ways(reference, jnp.asarray(starts), times))
        # In its plane the circle's rate is slowed down or built up on the way, too.
        ranges = np.linalg.norm(found[..., :3], axis=2)
        assert np.all(ranges.min(axis=1) > 0.9 * lesser - 1e-9)
        assert np.all(ranges.max(axis=1) < greater + 0.1 * lesser + 1e-9)
        np.testing.assert_allclose(found[:, 0], starts, atol=1e-12)
        joined = np.asarray(ways(replace(reference, join=jnp.asarray(0.0)), jnp.asarray(starts), times[-1:]))
        np.testing.assert_allclose(found[:, -1], joined[:, 0], atol=1e-11)


def test_a_start_opposite_to_the_entry_is_reached_around_the_target() -> None:
    reference = circle([0.0, 0.0, 1.0], 0.0, 2400.0, 0.0)
    found = np.asarray(ways(reference, jnp.array([[0.0, -40.0, 0.0, 0.0, 0.0, 0.0]]), jnp.linspace(0.0, 2400.0, 201)))
    np.testing.assert_allclose(np.linalg.norm(found[0, :, :3], axis=1), 40.0, rtol=1e-12)
    np.testing.assert_allclose(found[0, 100, 1:3], 0.0, atol=1e-9)


def test_derivatives_of_a_join_to_entry_and_parameters_are_finite() -> None:
    slopes = jax.jit(jax.jacrev(lambda reference, start, elapsed: fly_around.state(reference, start, AT, elapsed),
                                argnums=(0, 1, 2)))  # fmt: skip
    for start in (None, 0.3):
        for place in ([0.0, -45.0, 0.0], [0.0, 0.0, 50.0], [0.0, 1e-9, 50.0], [0.0, 0.0, 0.0]):
            for elapsed in (0.0, 300.0, 2400.0):
                reference = circle([0.0, 0.0, 1.0], RATE, 2400.0, start)
                found = slopes(reference, entry(*place, 0.0, 0.0, 0.0, e=0.0), jnp.asarray(elapsed))
                assert all(bool(jnp.all(jnp.isfinite(each))) for each in jax.tree.leaves(found))
