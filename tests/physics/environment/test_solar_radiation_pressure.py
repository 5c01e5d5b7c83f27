"""Solar radiation pressure: numbers worked by hand, penumbra and umbra."""

import jax
import numpy as np
import pytest
from numpy_reference import RADIUS

from rpojax.physics.environment.solar_radiation_pressure import Sunlight, solar_radiation_pressure, sunlit_fraction
from rpojax.physics.environment.spacecraft_surface import Surface
from rpojax.scenario.params import Params


@jax.jit
def srp_force(light: Sunlight, surface: Surface, r_N: jax.Array, r_sun_N: jax.Array) -> jax.Array:
    return solar_radiation_pressure(light, surface, r_N, r_sun_N, sunlit_fraction(light, r_N, r_sun_N))


SUN = np.array([1.495978707e11, 0.0, 0.0])


@pytest.fixture(scope="module")
def light(params: Params) -> Sunlight:
    """Sunlight of 1361 W/m^2 at one astronomical unit."""
    return params.plant.sunlight


def test_the_force_of_sunlight_agrees_with_a_number_worked_by_hand(light: Sunlight, surface: Surface) -> None:
    r = np.array([0.0, 7.0e6, 0.0])
    found = srp_force(light, surface, r, SUN)
    away = r - SUN
    # 1361 W/m^2 over the speed of light are 4.5398 uPa, on 0.25 m^2 with coefficient 1.3: 1.4754 uN.
    size = 1361.0 / 299792458.0 * 0.25 * 1.3
    np.testing.assert_allclose(size, 1.4754e-6, rtol=1e-4)
    np.testing.assert_allclose(found, size * away / np.linalg.norm(away), rtol=1e-8)


def test_the_force_of_sunlight_falls_with_the_square_of_the_distance(light: Sunlight, surface: Surface) -> None:
    near, far = (srp_force(light, surface, np.array([0.0, 7e6, 0.0]), k * SUN)[0] for k in (0.5, 2.0))
    np.testing.assert_allclose(near / far, 16.0, rtol=1e-7)


def test_the_force_of_sunlight_is_reduced_in_penumbra_and_zero_in_umbra(light: Sunlight, surface: Surface) -> None:
    lit, dark = (srp_force(light, surface, np.array([x, 0.0, 0.0]), SUN) for x in (7e6, -7e6))
    assert float(lit[0]) < 0.0
    np.testing.assert_array_equal(dark, np.zeros(3))
    # On the axis beyond the umbra the eclipse is annular; radii as seen from 2 million km.
    r = np.array([-2.0e9, 0.0, 0.0])
    ring = 1.0 - ((RADIUS / 2.0e9) / (6.957e8 / (SUN[0] + 2.0e9))) ** 2
    size = 1361.0 / 299792458.0 * 0.25 * 1.3 * (SUN[0] / (SUN[0] + 2.0e9)) ** 2
    np.testing.assert_allclose(srp_force(light, surface, r, SUN), [-ring * size, 0.0, 0.0], rtol=1e-4)
