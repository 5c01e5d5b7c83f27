"""Attitudes away from the target: axes of the camera in numpy."""

import jax
import jax.numpy as jnp
import numpy as np
import rendezvous_scene
from numpy_reference import rotation_matrix, unit

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import other_pointing

MOUNTING = unit(np.array([0.5, -0.3, 0.7, 0.2]))
SUN = 1.5e11 * unit(np.array([0.8, 0.5, -0.2]))


def test_the_camera_looks_away_from_the_sun_and_does_not_turn(flight: FlightParams) -> None:
    vehicle = replace(flight.vehicle, camera_mounting=jnp.asarray(MOUNTING))
    estimate = rendezvous_scene.estimate(flight)
    q_BN, rate = jax.jit(other_pointing.sun_safe_attitude)(vehicle, estimate, SUN)
    R_KN = rotation_matrix(MOUNTING) @ rotation_matrix(np.asarray(q_BN))
    np.testing.assert_allclose(R_KN[2], -unit(SUN - rendezvous_scene.R_SN_N), atol=1e-9)
    # Its x axis is as near to the pole as can be.
    assert R_KN[0, 2] > 0.9
    np.testing.assert_allclose(R_KN[1, 2], 0.0, atol=1e-9)
    np.testing.assert_array_equal(rate, np.zeros(3))


def test_the_camera_along_the_velocity_turns_with_the_orbit(flight: FlightParams) -> None:
    vehicle = replace(flight.vehicle, camera_mounting=jnp.asarray(MOUNTING))
    estimate = rendezvous_scene.estimate(flight)
    q_BN, rate = jax.jit(other_pointing.velocity_attitude)(vehicle, estimate)
    R_BN = rotation_matrix(np.asarray(q_BN))
    R_KN = rotation_matrix(MOUNTING) @ R_BN
    np.testing.assert_allclose(R_KN[2], unit(rendezvous_scene.V_SN_N), atol=1e-9)
    normal = unit(np.cross(rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N))
    np.testing.assert_allclose(R_KN[0], normal, atol=1e-9)
    np.testing.assert_allclose(rate, R_BN @ rendezvous_scene.HILL_RATE, rtol=1e-9)
