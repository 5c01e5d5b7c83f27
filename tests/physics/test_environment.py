"""Air, sunlight and the gravity-gradient torque: numbers worked by hand, and independent formulations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from numpy_reference import MU, RADIUS, SEEDS, random_unit, relative_error

from rpojax.core.pytree import replace
from rpojax.physics import environment
from rpojax.physics.environment import Atmosphere, Sunlight, Surface
from rpojax.scenario.params import Params

drag = jax.jit(environment.drag)


@jax.jit
def light_pressure(light: Sunlight, surface: Surface, r_N: jax.Array, r_sun_N: jax.Array) -> jax.Array:
    return environment.solar_radiation_pressure(
        light, surface, r_N, r_sun_N, environment.sunlit_fraction(light, r_N, r_sun_N)
    )


gravity_gradient_torque = jax.jit(environment.gravity_gradient_torque)

HEIGHT = RADIUS + 500e3
SUN = np.array([1.495978707e11, 0.0, 0.0])


@pytest.fixture(scope="module")
def air(params: Params) -> Atmosphere:
    """Air of 5e-13 kg/m^3 at 500 km, turning with the Earth."""
    return params.plant.atmosphere


@pytest.fixture(scope="module")
def light(params: Params) -> Sunlight:
    """Sunlight of 1361 W/m^2 at one astronomical unit."""
    return params.plant.sunlight


@pytest.fixture(scope="module")
def surface(params: Params) -> Surface:
    """0.25 m^2, drag coefficient 2.2, light pressure coefficient 1.3."""
    return params.plant.servicer_surface


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


def test_sunlight_pushes_away_from_the_sun_with_its_pressure_on_the_surface(light: Sunlight, surface: Surface) -> None:
    r = np.array([0.0, 7.0e6, 0.0])
    found = light_pressure(light, surface, r, SUN)
    away = r - SUN
    # 1361 W/m^2 over the speed of light are 4.5398 uPa, on 0.25 m^2 with coefficient 1.3: 1.4754 uN.
    size = 1361.0 / 299792458.0 * 0.25 * 1.3
    np.testing.assert_allclose(size, 1.4754e-6, rtol=1e-4)
    np.testing.assert_allclose(found, size * away / np.linalg.norm(away), rtol=1e-8)


def test_sunlight_falls_with_the_square_of_the_distance(light: Sunlight, surface: Surface) -> None:
    near, far = (light_pressure(light, surface, np.array([0.0, 7e6, 0.0]), k * SUN)[0] for k in (0.5, 2.0))
    np.testing.assert_allclose(near / far, 16.0, rtol=1e-7)


def test_sunlight_pushes_less_in_the_penumbra_and_not_at_all_in_the_umbra(light: Sunlight, surface: Surface) -> None:
    lit, dark = (light_pressure(light, surface, np.array([x, 0.0, 0.0]), SUN) for x in (7e6, -7e6))
    assert float(lit[0]) < 0.0
    np.testing.assert_array_equal(dark, np.zeros(3))
    # On the axis beyond the umbra a ring of the Sun is left: by the ratio of the radii, seen from 2 million km.
    r = np.array([-2.0e9, 0.0, 0.0])
    ring = 1.0 - ((RADIUS / 2.0e9) / (6.957e8 / (SUN[0] + 2.0e9))) ** 2
    size = 1361.0 / 299792458.0 * 0.25 * 1.3 * (SUN[0] / (SUN[0] + 2.0e9)) ** 2
    np.testing.assert_allclose(light_pressure(light, surface, r, SUN), [-ring * size, 0.0, 0.0], rtol=1e-4)


@given(SEEDS)
def test_the_gravity_gradient_torque_is_that_of_gravity_on_the_bodys_parts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    r = (7.0e6 * random_unit(rng)).astype(np.longdouble)
    masses = np.repeat(rng.uniform(1.0, 20.0, 3), 2)
    half = rng.normal(size=(3, 3))
    places = np.concatenate([half, -half])[[0, 3, 1, 4, 2, 5]]  # pairs about the centre of mass
    inertia = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, places, strict=True))
    torque = np.zeros(3, dtype=np.longdouble)
    for m, p in zip(masses, places, strict=True):
        at = r + p
        pull = -np.longdouble(MU) * m * at / np.sqrt(np.sum(at * at)) ** 3
        torque = torque + np.cross(p, pull)
    found = np.asarray(gravity_gradient_torque(r.astype(float), inertia))
    # The formula is the first order in size over distance, 2e-7; in pairs the second order cancels as well.
    assert relative_error(found, torque.astype(float)) < 1e-6


def test_a_body_with_a_principal_axis_along_the_vertical_feels_no_torque() -> None:
    found = gravity_gradient_torque(np.array([0.0, 7.0e6, 0.0]), np.diag([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(found, np.zeros(3))
