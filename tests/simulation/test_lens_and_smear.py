"""Optics of the camera in a run: boxes and landmarks corrected for the lens, and the smear of a picture."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.physics.plant_state import Truth
from rpojax.scenario.params import Params
from rpojax.sensors import camera_pose, geometric_camera
from rpojax.simulation import camera_models, tick_measurements

LENS = jnp.array([-0.25, 0.06, 3e-4, -2e-4, 0.0])
SIZE, FOCAL = 768, 927.0
CUBE = np.array([[x, y, z] for x in (-0.4, 0.4) for y in (-0.6, 0.6) for z in (-0.3, 0.3)])


def measured_edges(params: Params, hull_K: np.ndarray, distortion: jax.Array | None) -> tuple[np.ndarray, np.ndarray]:
    """Edges [px] of the box of a hull in a frame through a lens, and as flight software corrects them."""
    field_of_view = jnp.asarray(2.0 * np.arctan(0.5 * SIZE / FOCAL))
    camera = replace(params.camera, field_of_view=field_of_view, distortion=distortion)
    seen = jnp.asarray([0.5, 0.9, 0.5, 0.5, 0.5, 0.5])
    yes = jnp.asarray(True)
    frame = geometric_camera.measure(camera, SIZE, SIZE, jnp.asarray(hull_K), yes, yes, jnp.zeros(4), seen)
    edges = frame.box.edges
    if distortion is None:
        return np.asarray(edges), np.asarray(edges)
    center_px = jnp.full(2, 0.5 * SIZE)
    corrected = tick_measurements._corrected_edges(distortion, edges, center_px, jnp.asarray(FOCAL))
    return np.asarray(edges), np.asarray(corrected)


@pytest.mark.parametrize("place", [(0.0, 0.0, 15.0), (4.0, -3.0, 15.0), (-9.0, 8.0, 30.0)])
def test_box_is_corrected_for_the_nominal_lens(params: Params, place: tuple[float, float, float]) -> None:
    hull = CUBE + np.array(place)
    plain, _ = measured_edges(params, hull, None)
    shown, corrected = measured_edges(params, hull, LENS)
    moved = np.abs(shown - plain).max()
    assert moved > (5.0 if place[0] else 0.02)
    # A straight edge is shown bent, and the box is around it.
    assert np.abs(corrected - plain).max() < 0.15 * moved + 0.02


def turned(truth: Truth, dt: float) -> Truth:
    """The truth after a time [s], by its rates alone."""
    turn = quaternion.exp(-truth.omega_BN_B * dt)
    return replace(truth, q_BN=quaternion.multiply(turn, truth.q_BN), r_ST_N=truth.r_ST_N + dt * truth.v_ST_N)


def test_smear_is_the_way_of_the_target_in_the_picture(params: Params) -> None:
    params = replace(params, imaging=replace(params.imaging, exposure_time=jnp.asarray(0.2)))
    mounting = quaternion.normalize(params.camera.mounting)
    q_KN = quaternion.normalize(jnp.array([0.3, -0.5, 0.2, 0.8]))
    q_BN = quaternion.multiply(quaternion.conjugate(mounting), q_KN)
    in_camera = jnp.array([0.4, -0.7, 12.0])
    truth = Truth(
        r_TN_N=jnp.zeros(3),
        v_TN_N=jnp.zeros(3),
        r_ST_N=quaternion.rotate(quaternion.conjugate(q_KN), -in_camera),
        v_ST_N=jnp.array([0.02, -0.05, 0.04]),
        q_BN=q_BN,
        omega_BN_B=jnp.array([0.01, -0.02, 0.015]),
        wheel_speed=jnp.zeros(3),
        q_TN=jnp.array([1.0, 0.0, 0.0, 0.0]),
        omega_TN_T=jnp.zeros(3),
        mass=jnp.asarray(100.0),
        delta_v=jnp.asarray(0.0),
    )

    def place(dt: float) -> np.ndarray:
        moved = turned(truth, dt)
        _, r_TK_K = camera_pose.target_pose_in_camera(params.camera, moved.q_TN, moved.r_ST_N, moved.q_BN)
        return np.asarray(r_TK_K[:2] / r_TK_K[2])

    smear = camera_models._smear(params, truth)
    assert smear is not None
    np.testing.assert_allclose(smear, place(0.1) - place(-0.1), rtol=1e-4)
    at_rest = replace(params, imaging=replace(params.imaging, exposure_time=None))
    assert camera_models._smear(at_rest, truth) is None
