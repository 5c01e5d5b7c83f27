"""The believed acceleration by drag and sunlight against that of the plant."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.flight.navigation import differential_drag
from rpojax.physics.environment.drag import drag
from rpojax.physics.environment.solar_radiation_pressure import Sunlight, solar_radiation_pressure
from rpojax.physics.environment.spacecraft_surface import Surface
from rpojax.scenario.params import Params


@pytest.mark.parametrize("in_shadow", [False, True])
def test_the_acceleration_is_that_of_the_plant_for_a_surface_of_these_coefficients(
    params: Params, in_shadow: bool
) -> None:
    r_N = 6.8e6 * np.array([0.36, 0.48, 0.8]) * (-1.0 if in_shadow else 1.0)
    v_N = 7.6e3 * np.array([-0.8, 0.6, 0.0])
    sun_N = jnp.asarray(1.495978707e11 * np.array([0.36, 0.48, 0.8]))
    surface = Surface(
        area=jnp.asarray(1.0),
        drag_coefficient=jnp.asarray(2.2),
        pressure_coefficient=jnp.asarray(1.3),
        center_of_pressure=jnp.zeros(3),
    )
    of_air = drag(params.plant.atmosphere, surface, 6378137.0, jnp.asarray(r_N), jnp.asarray(v_N))
    of_light = solar_radiation_pressure(
        Sunlight(flux=jnp.asarray(1361.0)), surface, jnp.asarray(r_N), sun_N, jnp.asarray(0.0 if in_shadow else 1.0)
    )
    found = differential_drag.ballistic_acceleration(
        params.flight.atmosphere, jnp.asarray(r_N), jnp.asarray(v_N), sun_N
    )
    np.testing.assert_allclose(found, of_air + of_light, rtol=1e-4)
