"""Fly-arounds: circles by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from relative_motion_cases import advanced, entry, orbit

from rpojax.flight.guidance.references import fly_around
from rpojax.flight.guidance.references.fly_around import FlyAround

state = jax.jit(fly_around.state)
RATE = np.deg2rad(90.0) / 600.0


def position(axis: list[float], elapsed: float, start: float | None, *at_entry: float) -> np.ndarray:
    reference = FlyAround(
        radius=jnp.asarray(40.0),
        axis=jnp.asarray(axis),
        rate=jnp.asarray(RATE),
        join=jnp.asarray(0.0),
        start=None if start is None else jnp.asarray(start),
    )
    seconds = jnp.asarray(elapsed)
    found = state(reference, entry(*at_entry, 0.0, 0.0, 0.0), advanced(orbit(0.1), seconds), seconds)
    return np.asarray(found)[:3]


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
