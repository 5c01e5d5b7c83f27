"""Box measurement model: linearisation and noise."""

import jax
import numpy as np
import rendezvous_scene
from hypothesis import given
from numpy_reference import SEEDS, random_unit, rotation_matrix, unit

from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation.box_measurement import box_measurement_model
from rpojax.flight.navigation.box_measurement.box_measurement_model import LinearisedBox
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, box_view
from rpojax.scenario.params import Params


@jax.jit
def linearise_box(
    flight: FlightParams, q_KN: jax.Array, r_TS_N: jax.Array, box: BoxMeasurement, slow_scale: float = 0.0
) -> LinearisedBox:
    view = box_view(box, flight.vehicle.focal_px, q_KN)
    return box_measurement_model.linearise_box(flight.navigation, view, r_TS_N, slow_scale)


box_derivative = jax.jit(jax.jacfwd(lambda *arguments: linearise_box(*arguments).predicted, argnums=2))


def seen(
    flight: FlightParams, q_KN: np.ndarray, r_TS_N: np.ndarray = rendezvous_scene.TARGET_AHEAD, **flags: bool
) -> BoxMeasurement:
    return rendezvous_scene.box(flight, rotation_matrix(q_KN), r_TS_N, **flags)


@given(SEEDS)
def test_the_position_jacobian_is_the_derivative_of_the_box(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q_KN = random_unit(rng, 4)
    R_KN = rotation_matrix(q_KN)
    # Anywhere within 45 deg of the boresight; beyond 60 deg the model holds the depth on purpose.
    r_TS_N = rng.uniform(5.0, 100.0) * R_KN.T @ unit(np.array([*rng.uniform(-0.7, 0.7, 2), 1.0]))
    box = rendezvous_scene.box(params.flight, R_KN, r_TS_N)

    model = linearise_box(params.flight, q_KN, r_TS_N, box)
    np.testing.assert_allclose(model.position_jacobian, box_derivative(params.flight, q_KN, r_TS_N, box), atol=1e-14)
    r_K = R_KN @ r_TS_N
    expected = [r_K[0] / r_K[2], r_K[1] / r_K[2], np.log(1.063 / np.linalg.norm(r_TS_N))]
    np.testing.assert_allclose(model.predicted, expected, atol=1e-13)


def test_the_noise_of_a_box_is_that_of_its_edges_and_of_the_camera(flight: FlightParams, q_KN: np.ndarray) -> None:
    focal = float(flight.vehicle.focal_px)

    def noise(truncated: bool) -> np.ndarray:
        box = seen(flight, q_KN, truncated=truncated)
        return np.asarray(linearise_box(flight, q_KN, rendezvous_scene.TARGET_AHEAD, box).variance)

    whole, cut = noise(False), noise(True)
    # Two edges of 1 px make a centre of 1/sqrt(2) px; 0.004 deg. The wandering centre is a state, not noise.
    bearing = 0.5 / focal**2 + np.deg2rad(0.004) ** 2
    np.testing.assert_allclose(whole[:2], bearing, rtol=1e-12)
    side = focal * 1.063 / 30.0
    assert 0.5 < whole[2] * side**2 < 2.0  # a pixel or so of a side
    np.testing.assert_allclose(cut[:2], bearing + (0.5 * side / focal) ** 2, rtol=1e-12)
