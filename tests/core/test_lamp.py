"""Lamp: reach, beam, and the light that a camera sees the target by."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core import lamp
from rpojax.core.lamp import Lamp
from rpojax.core.orbits import camera_visibility

LAMP = Lamp(boresight=jnp.array([2.0, 0.0, 0.0]), beam_half_angle=jnp.deg2rad(20.0), reach=jnp.float64(60.0))

lights = jax.jit(lamp.lights)


def place(distance: float, off_deg: float) -> np.ndarray:
    off = np.deg2rad(off_deg)
    return distance * np.array([np.cos(off), 0.6 * np.sin(off), -0.8 * np.sin(off)])


@pytest.mark.parametrize(
    ("distance", "off_deg", "lit"),
    [(59.9, 0.0, True), (60.1, 0.0, False), (30.0, 19.9, True), (30.0, 20.1, False), (30.0, 180.0, False)],
    ids=["near enough", "too far", "in the beam", "beside the beam", "behind the lamp"],
)
def test_a_target_is_lit_within_the_reach_and_the_beam(distance: float, off_deg: float, lit: bool) -> None:
    assert bool(lights(LAMP, place(distance, off_deg))) is lit


def test_a_tolerance_widens_beam_and_reach_by_the_same_angle() -> None:
    tolerance = np.deg2rad(10.0)
    assert bool(lights(LAMP, place(30.0, 29.9), tolerance))
    assert not bool(lights(LAMP, place(30.0, 30.1), tolerance))
    farthest = 60.0 / (1.0 - np.sin(tolerance))
    assert bool(lights(LAMP, place(0.999 * farthest, 0.0), tolerance))
    assert not bool(lights(LAMP, place(1.001 * farthest, 0.0), tolerance))
    assert bool(lights(LAMP, place(1000.0, 179.0), np.pi))  # nothing is known of the direction


def test_distances_have_finite_gradients_through_the_lamp() -> None:
    def range_where_lit(r_TS_B: jax.Array) -> jax.Array:
        return jnp.where(lamp.lights(LAMP, r_TS_B), jnp.sum(r_TS_B**2), 0.0)

    slope = jax.jit(jax.grad(range_where_lit))
    np.testing.assert_allclose(slope(place(30.0, 5.0)), 2.0 * place(30.0, 5.0))
    np.testing.assert_array_equal(slope(jnp.zeros(3)), 0.0)


SUN = np.array([1.496e11, 0.0, 0.0])
DAY, NIGHT = np.array([7.0e6, 0.0, 0.0]), np.array([-7.0e6, 0.0, 0.0])
TOWARDS_SUN, SIDE, AWAY = np.array([-40.0, 0.0, 0.0]), np.array([0.0, 40.0, 0.0]), np.array([-12.0, 38.0, 0.0])


@pytest.mark.parametrize(
    ("r_TN_N", "r_ST_N", "lamplit", "by_sun", "by_lamp"),
    [
        (DAY, SIDE, False, True, False),
        (DAY, SIDE, True, True, True),
        (NIGHT, SIDE, False, False, False),
        (NIGHT, SIDE, True, False, True),
        (DAY, AWAY, True, False, True),
        (DAY, TOWARDS_SUN, True, False, False),
        (NIGHT, TOWARDS_SUN, True, False, True),
    ],
    ids=[
        "the Sun alone", "both", "eclipse", "lamp in eclipse", "lamp beyond the phase limit",
        "the Sun blinds", "the Sun is behind the Earth",
    ],
)  # fmt: skip
def test_the_target_is_seen_by_sun_or_lamp(
    r_TN_N: np.ndarray, r_ST_N: np.ndarray, lamplit: bool, by_sun: bool, by_lamp: bool
) -> None:
    limits = jnp.deg2rad(100.0), jnp.deg2rad(30.0)
    found = jax.jit(camera_visibility.light_sources)(r_TN_N, r_ST_N, SUN, *limits, jnp.asarray(lamplit))
    assert tuple(map(bool, found)) == (by_sun, by_lamp)
