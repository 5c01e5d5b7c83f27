"""Drag: numbers worked by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy_reference import RADIUS

from rpojax.core.orbits.exponential_atmosphere import Atmosphere
from rpojax.core.pytree import replace
from rpojax.physics.environment.drag import drag
from rpojax.physics.environment.spacecraft_surface import Surface
from rpojax.scenario.params import Params

drag_force = jax.jit(drag)
HEIGHT = RADIUS + 500e3


@pytest.fixture(scope="module")
def air(params: Params) -> Atmosphere:
    """Air of 5e-13 kg/m^3 at 500 km, rotating with the Earth."""
    return params.plant.atmosphere


def drag_at(air: Atmosphere, surface: Surface, r: list[float], v: list[float]) -> np.ndarray:
    return np.asarray(drag_force(air, surface, jnp.float64(RADIUS), np.array(r), np.array(v)))


def test_drag_over_the_pole_agrees_with_a_number_worked_by_hand(air: Atmosphere, surface: Surface) -> None:
    # Over the pole the air is at rest: 0.5 * 5e-13 * 2.2 * 0.25 * 7600^2.
    found = drag_at(air, surface, [0.0, 0.0, HEIGHT], [7600.0, 0.0, 0.0])
    np.testing.assert_allclose(found, [-0.5 * 5e-13 * 2.2 * 0.25 * 7600.0**2, 0.0, 0.0], rtol=1e-12)


@pytest.mark.parametrize("sense", [1.0, -1.0], ids=["east", "west"])
def test_rotation_of_the_atmosphere_reduces_drag_on_an_eastward_orbit(
    air: Atmosphere, surface: Surface, sense: float
) -> None:
    speed = 7600.0 - sense * 7.292115e-5 * HEIGHT
    found = drag_at(air, surface, [HEIGHT, 0.0, 0.0], [0.0, sense * 7600.0, 0.0])
    np.testing.assert_allclose(found, [0.0, -sense * 1.375e-13 * speed**2, 0.0], rtol=1e-12)


def test_rotation_of_the_atmosphere_gives_a_polar_orbit_a_side_force_over_the_equator(
    air: Atmosphere, surface: Surface
) -> None:
    side = 7.292115e-5 * HEIGHT
    found = drag_at(air, surface, [HEIGHT, 0.0, 0.0], [0.0, 0.0, 7600.0])
    expected = 1.375e-13 * np.hypot(7600.0, side) * np.array([0.0, side, -7600.0])
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_drag_without_rotation_is_opposite_to_the_velocity(air: Atmosphere, surface: Surface) -> None:
    still = replace(air, rotation=jnp.zeros(()))
    v = np.array([3000.0, 5000.0, -4000.0])
    found = drag_at(still, surface, [HEIGHT, 0.0, 0.0], list(v))
    np.testing.assert_allclose(found, -1.375e-13 * np.linalg.norm(v) * v, rtol=1e-12)


def test_density_falls_by_e_over_a_scale_height(air: Atmosphere, surface: Surface) -> None:
    low, high = (drag_at(air, surface, [0.0, 0.0, HEIGHT + h], [7600.0, 0.0, 0.0])[0] for h in (0.0, 63e3))
    np.testing.assert_allclose(low / high, np.e, rtol=1e-12)


def test_drag_and_its_derivative_vanish_without_relative_velocity(air: Atmosphere, surface: Surface) -> None:
    still, r = replace(air, rotation=jnp.zeros(())), np.array([HEIGHT, 0.0, 0.0])
    force, derivative = jax.jvp(
        lambda v: drag_force(still, surface, jnp.float64(RADIUS), r, v), (np.zeros(3),), (np.ones(3),)
    )
    np.testing.assert_array_equal(force, np.zeros(3))
    np.testing.assert_array_equal(derivative, np.zeros(3))
