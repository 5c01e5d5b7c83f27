"""Position of a target by one box, and its use while the range is uncertain."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene

from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import relative_orbit_ekf
from rpojax.flight.navigation.box_measurement import box_measurement_model, outlier_gate
from rpojax.flight.navigation.orbit_measurements import box_view


def test_the_position_by_a_box_without_error_is_that_of_the_target(flight: FlightParams) -> None:
    known = rendezvous_scene.estimate(flight)
    q_KN = rendezvous_scene.camera_attitude(flight, known)
    R_KN = np.asarray(quaternion.to_matrix(jnp.asarray(q_KN)))
    target = rendezvous_scene.TARGET_AHEAD + np.array([2.0, -1.0, 3.0])
    box = rendezvous_scene.box(flight, R_KN, target)
    measured = jnp.concatenate([box.tangent, box.log_size[None]])
    found = jax.jit(box_measurement_model.position_by_box)(R_KN, flight.navigation.target_size, measured)
    np.testing.assert_allclose(found, target, rtol=1e-12)


@pytest.mark.parametrize(("sigma", "wide"), [(8.9, False), (9.1, True)])
def test_the_range_is_wide_beyond_three_tenths(flight: FlightParams, sigma: float, wide: bool) -> None:
    covariance = jnp.asarray(sigma**2 * np.eye(3))
    assert bool(box_measurement_model.is_range_wide(jnp.asarray(rendezvous_scene.TARGET_AHEAD), covariance)) is wide


@pytest.mark.parametrize("believed", [0.3, 3.0, 10.0])
def test_two_boxes_find_a_target_at_a_range_far_from_the_believed_one(flight: FlightParams, believed: float) -> None:
    target = rendezvous_scene.TARGET_AHEAD
    true = rendezvous_scene.estimate(flight)
    q_KN = rendezvous_scene.camera_attitude(flight, true)
    box = rendezvous_scene.box(flight, np.asarray(quaternion.to_matrix(jnp.asarray(q_KN))), target)
    # Wide along the line of sight, as after a long time in the dark.
    sigma = 0.8 * max(believed, 1.0) * np.linalg.norm(target)
    estimate = rendezvous_scene.estimate(flight, believed * target, position_sigma=sigma).relative
    gate = outlier_gate.initial()
    update = jax.jit(relative_orbit_ekf.update, static_argnums=1)
    for _ in range(2):
        estimate, gate, innovation, _ = update(
            flight.navigation, True, estimate, gate, box_view(box, flight.vehicle.focal_px, jnp.asarray(q_KN))
        )
    assert bool(innovation.accepted)
    error = np.linalg.norm(np.asarray(estimate.r_TS_N) - target) / np.linalg.norm(target)
    spread = np.sqrt(np.trace(np.asarray(estimate.covariance)[:3, :3])) / np.linalg.norm(target)
    assert error < 0.1  # of a box without error; the size is known to 15 %
    assert 0.1 < spread < 0.25


def test_a_part_of_a_target_behind_the_estimated_place_is_found_in_front_of_the_camera(flight: FlightParams) -> None:
    target = 20.0 * rendezvous_scene.TARGET_AHEAD / 30.0
    q_KN = rendezvous_scene.camera_attitude(flight, rendezvous_scene.estimate(flight))
    R_KN = np.asarray(quaternion.to_matrix(jnp.asarray(q_KN)))
    box = rendezvous_scene.box(flight, R_KN, target + R_KN.T @ np.array([1.5, 0.0, 0.0]), truncated=True)
    # The frame shows half of it; by the estimate it is on the other side.
    box = replace(box, log_size=box.log_size - 0.7, side_px=0.5 * box.side_px)
    estimate = rendezvous_scene.estimate(flight, -100.0 * target / 20.0, position_sigma=150.0).relative
    gate = outlier_gate.initial()
    update = jax.jit(relative_orbit_ekf.update, static_argnums=1)
    for _ in range(3):
        estimate, gate, innovation, _ = update(
            flight.navigation, True, estimate, gate, box_view(box, flight.vehicle.focal_px, jnp.asarray(q_KN))
        )
    assert bool(innovation.accepted)
    found = R_KN @ np.asarray(estimate.r_TS_N)
    assert found[2] > 0.0
    assert np.linalg.norm(found[:2]) / found[2] < np.deg2rad(10.0)
    error = np.linalg.norm(np.asarray(estimate.r_TS_N) - target)
    assert error < 3.0 * np.sqrt(np.trace(np.asarray(estimate.covariance)[:3, :3]))
