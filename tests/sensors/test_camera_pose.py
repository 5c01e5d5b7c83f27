"""Camera mounting, misalignment and hull points in camera axes."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from numpy_reference import SEEDS, attitude_difference, axis_angle_quaternion, random_unit, rotation_matrix

from rpojax.core.pytree import replace
from rpojax.scenario.params import Params
from rpojax.sensors import camera_pose
from rpojax.sensors.camera import Camera

EXACT = 1e-12  # roundings of pixels


@jax.jit
def hull_in_camera(camera: Camera, hull_T: jax.Array, q_TN: jax.Array, r_ST_N: jax.Array, q_BN: jax.Array) -> jax.Array:
    return camera_pose.hull_in_camera(hull_T, *camera_pose.target_pose_in_camera(camera, q_TN, r_ST_N, q_BN))


attitude = jax.jit(camera_pose.camera_attitude)


def test_the_nominal_mounting_looks_along_body_x_with_image_right_along_body_y(params: Params) -> None:
    hull = hull_in_camera(params.camera, np.eye(3), axis_angle_quaternion([0, 0, 1], 0.0), np.array([-40.0, 0.0, 0.0]),
                          axis_angle_quaternion([0, 0, 1], 0.0))  # fmt: skip
    np.testing.assert_allclose(hull, [[0, 0, 41], [1, 0, 40], [0, 1, 40]], atol=EXACT)


@given(SEEDS)
def test_hull_points_in_camera_axes_agree_with_inertial_positions(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q_TN, q_BN = random_unit(rng, 4), random_unit(rng, 4)
    hull_T, r_ST_N = rng.normal(size=(5, 3)), 40.0 * random_unit(rng)
    misalignment = 0.1 * random_unit(rng)
    camera = replace(params.camera, misalignment=jnp.asarray(misalignment))
    R_KB = rotation_matrix(axis_angle_quaternion(misalignment, 0.1)) @ np.array(
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    )
    places_N = hull_T @ rotation_matrix(q_TN) - r_ST_N
    expected = places_N @ rotation_matrix(q_BN).T @ R_KB.T
    np.testing.assert_allclose(hull_in_camera(camera, hull_T, q_TN, r_ST_N, q_BN), expected, atol=1e-12)


def test_misalignment_rotates_the_camera_about_its_own_axes(params: Params) -> None:
    q_BN = random_unit(np.random.default_rng(9), 4)
    straight = np.asarray(attitude(params.camera, q_BN))
    turned = np.asarray(attitude(replace(params.camera, misalignment=jnp.array([0.0, 0.0, 0.1])), q_BN))
    np.testing.assert_allclose(attitude_difference(straight, turned), 0.1, rtol=1e-12)
    np.testing.assert_allclose(
        rotation_matrix(turned)[2], rotation_matrix(straight)[2], atol=1e-12
    )  # the boresight stays
