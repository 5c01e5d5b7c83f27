"""Drag: numbers worked by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy_reference import RADIUS

from rpojax.core.pytree import replace
from rpojax.physics.environment.drag import Atmosphere, drag
from rpojax.physics.environment.surface import Surface
from rpojax.scenario.params import Params

drag = jax.jit(drag)
HEIGHT = RADIUS + 500e3


@pytest.fixture(scope="module")
def air(params: Params) -> Atmosphere:
    """Air of 5e-13 kg/m^3 at 500 km, turning with the Earth."""
    return params.plant.atmosphere


def wind(air: Atmosphere, surface: Surface, r: list[float], v: list[float]) -> np.ndarray:
    return np.asarray(drag(air, surface, jnp.float64(RADIUS), np.array(r), np.array(v)))


def test_drag_on_a_polar_orbit_over_the_pole_is_worked_by_hand(air: Atmosphere, surface: Surface) -> None:
    # Over the pole the air stands still: 0.5 * 5e-13 * 2.2 * 0.25 * 7600^2.
    found = wind(air, surface, [0.0, 0.0, HEIGHT], [7600.0, 0.0, 0.0])
    np.testing.assert_allclose(found, [-0.5 * 5e-13 * 2.2 * 0.25 * 7600.0**2, 0.0, 0.0], rtol=1e-12)


@pytest.mark.parametrize("sense", [1.0, -1.0], ids=["east", "west"])
def test_air_that_turns_with_the_earth_blows_weaker_from_ahead_on_the_way_east(
    air: Atmosphere, surface: Surface, sense: float
) -> None:
    speed = 7600.0 - sense * 7.292115e-5 * HEIGHT
    found = wind(air, surface, [HEIGHT, 0.0, 0.0], [0.0, sense * 7600.0, 0.0])
    np.testing.assert_allclose(found, [0.0, -sense * 1.375e-13 * speed**2, 0.0], rtol=1e-12)


def test_a_polar_orbit_over_the_equator_feels_the_air_from_the_side(air: Atmosphere, surface: Surface) -> None:
    side = 7.292115e-5 * HEIGHT
    found = wind(air, surface, [HEIGHT, 0.0, 0.0], [0.0, 0.0, 7600.0])
    expected = 1.375e-13 * np.hypot(7600.0, side) * np.array([0.0, side, -7600.0])
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_still_air_only_brakes(air: Atmosphere, surface: Surface) -> None:
    still = replace(air, rotation=jnp.zeros(()))
    v = np.array([3000.0, 5000.0, -4000.0])
    found = wind(still, surface, [HEIGHT, 0.0, 0.0], list(v))
    np.testing.assert_allclose(found, -1.375e-13 * np.linalg.norm(v) * v, rtol=1e-12)


def test_a_scale_height_further_up_the_air_is_thinner_by_e(air: Atmosphere, surface: Surface) -> None:
    low, high = (wind(air, surface, [0.0, 0.0, HEIGHT + h], [7600.0, 0.0, 0.0])[0] for h in (0.0, 63e3))
    np.testing.assert_allclose(low / high, np.e, rtol=1e-12)


def test_a_craft_at_rest_in_the_air_feels_no_drag_and_has_a_slope_of_zero(air: Atmosphere, surface: Surface) -> None:
    still, r = replace(air, rotation=jnp.zeros(())), np.array([HEIGHT, 0.0, 0.0])
    force, slope = jax.jvp(lambda v: drag(still, surface, jnp.float64(RADIUS), r, v), (np.zeros(3),), (np.ones(3),))
    np.testing.assert_array_equal(force, np.zeros(3))
    np.testing.assert_array_equal(slope, np.zeros(3))
