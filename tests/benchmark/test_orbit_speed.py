"""Orbit propagation of the benchmark, compared with the gravity of the package and with conserved quantities."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.benchmark import orbit_speed
from rpojax.core.constants import MU_EARTH
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.orbits import zonal_gravity


def test_j2_gravity_of_many_vehicles_is_that_of_each() -> None:
    r_N, _ = orbit_speed.initial_orbits(7)
    found = np.asarray(orbit_speed.j2_gravity(jnp.asarray(r_N)))
    for vehicle in range(7):
        position = Difference(value=jnp.asarray(r_N[:, vehicle]), change=jnp.zeros(3))
        expected = zonal_gravity.gravity(zonal_gravity.EARTH_GRAVITY, 2, position).value
        np.testing.assert_allclose(found[:, vehicle], expected, rtol=1e-13)


def test_rk4_step_conserves_energy_and_polar_angular_momentum() -> None:
    r_N, v_N = map(jnp.asarray, orbit_speed.initial_orbits(5))

    def invariants(r_N: jax.Array, v_N: jax.Array) -> tuple[np.ndarray, np.ndarray]:
        radius = np.linalg.norm(r_N, axis=0)
        sine2 = np.asarray(r_N[2] / radius) ** 2
        j2 = zonal_gravity.EARTH_GRAVITY.zonals[0] * (zonal_gravity.EARTH_GRAVITY.radius / radius) ** 2
        potential = -MU_EARTH / radius * (1.0 - j2 * (1.5 * sine2 - 0.5))
        return 0.5 * np.sum(np.asarray(v_N) ** 2, axis=0) + potential, np.asarray(r_N[0] * v_N[1] - r_N[1] * v_N[0])

    before = invariants(r_N, v_N)
    for _ in range(20):
        r_N, v_N = orbit_speed.rk4_step(r_N, v_N, orbit_speed.STEP_S)
    for old, new in zip(before, invariants(r_N, v_N), strict=True):
        np.testing.assert_allclose(new, old, rtol=1e-13)


def test_vehicles_are_counted_over_all_devices() -> None:
    found = orbit_speed.measure(vehicles=4, steps=3)
    assert found.vehicles == 4 * len(jax.devices())
    assert found.vehicle_steps_per_s == pytest.approx(found.vehicles * 3 / found.run_s)
