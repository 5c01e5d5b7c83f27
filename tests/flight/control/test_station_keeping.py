"""Station keeping against integrated relative motion."""

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rpojax.core.pytree import replace
from rpojax.flight.control import station_keeping
from rpojax.scenario.params import Params

RATE = np.float64(1.1e-3)  # mean motion at 500 km
PERIOD = 200.0
solve_station_keeping = jax.jit(station_keeping.solve_station_keeping, static_argnums=2)


def free_motion(_: float, state: np.ndarray) -> np.ndarray:
    """Clohessy and Wiltshire's equations."""
    n = float(RATE)
    x, _, z, u, v, w = state
    return np.array([u, v, w, 3.0 * n * n * x + 2.0 * n * v, -2.0 * n * u, -n * n * z])


@pytest.mark.parametrize("place", [(30.0, 0.0, 0.0), (0.0, 0.0, -20.0), (10.0, -25.0, 15.0)])
def test_the_free_motion_returns_to_a_station_off_the_along_track_axis(
    params: Params, place: tuple[float, float, float]
) -> None:
    formation = replace(params.flight.formation, desired_position=np.array(place))
    station = solve_station_keeping(formation, RATE, PERIOD)
    departure = np.asarray(station.arrival_velocity + station.impulse)
    start = np.concatenate([place, departure])
    found = solve_ivp(free_motion, (0.0, PERIOD), start, rtol=1e-11, atol=1e-11).y[:, -1]
    np.testing.assert_allclose(found[:3], place, atol=1e-7)
    np.testing.assert_allclose(found[3:], station.arrival_velocity, atol=1e-9)


def test_a_station_on_the_along_track_axis_needs_no_impulse(params: Params) -> None:
    station = solve_station_keeping(params.flight.formation, RATE, PERIOD)
    np.testing.assert_array_equal(station.arrival_velocity, 0.0)
    np.testing.assert_array_equal(station.impulse, 0.0)
