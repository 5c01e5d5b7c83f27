"""Choice of the detector's window in large frames."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from numpy_reference import IDENTITY

from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.flight import computer
from rpojax.flight.flight_records import FlightMemory, FlightParams
from rpojax.flight.guidance import detector_window
from rpojax.flight.guidance.detector_window import CameraCommand, CameraFormat
from rpojax.flight.stages import Stages

EXACT = 1e-3  # pixels, in single precision
LARGE = CameraFormat(width_px=512, height_px=512, input_px=128)
SMALL = CameraFormat(width_px=128, height_px=128, input_px=128)


@partial(jax.jit, static_argnums=1)
def initial(flight: FlightParams, camera: CameraFormat, *initial_values: jax.Array) -> FlightMemory:
    return computer.initial(rendezvous_scene.software(flight, camera=camera), *initial_values)


@partial(jax.jit, static_argnums=(0, 2))
def command_camera(
    stages: Stages, flight: FlightParams, camera: CameraFormat, memory: FlightMemory, time: jax.Array
) -> FlightMemory:
    return computer.command_camera(rendezvous_scene.software(flight, stages, camera), memory, time)


window_around = jax.jit(detector_window.window_around, static_argnums=0)


@jax.jit
def body_attitude(mounting: jax.Array, q_KN: jax.Array) -> jax.Array:
    """Attitude of a spacecraft from that of its camera."""
    return quaternion.multiply(quaternion.conjugate(quaternion.normalize(mounting)), q_KN)


def chosen(expected: tuple[float, float], size: float, tracked: bool, camera: CameraFormat = LARGE) -> CameraCommand:
    return window_around(camera, np.asarray(expected), size, tracked)


def test_the_window_of_a_small_frame_is_the_whole_frame() -> None:
    for tracked in (True, False):
        view = chosen((100.0, 20.0), 30.0, tracked, camera=SMALL)
        assert float(view.binning) == 1.0
        np.testing.assert_array_equal(view.corner_px, 0.0)


def test_the_window_for_a_lost_target_is_the_whole_frame() -> None:
    view = chosen((100.0, 300.0), 30.0, False)
    assert float(view.binning) == 4.0
    np.testing.assert_array_equal(view.corner_px, 0.0)


@pytest.mark.parametrize("expected", [(256.0, 256.0), (70.0, 400.0), (505.0, 3.0)])
def test_the_window_contains_a_tracked_target_and_is_inside_the_frame(expected: tuple[float, float]) -> None:
    view = chosen(expected, 40.0, True)
    span = 128.0 * float(view.binning)
    corner = np.asarray(view.corner_px)
    assert float(view.binning) == 1.0
    assert corner.min() >= 0.0
    assert (corner + span).max() <= 512.0
    assert (corner <= expected).all()
    assert (corner + span >= expected).all()


def test_the_window_of_a_large_target_is_binned() -> None:
    view = chosen((256.0, 256.0), 150.0, True)
    assert 150.0 / float(view.binning) == pytest.approx(detector_window.TARGET_FRACTION * 128.0, abs=EXACT)


def test_the_command_follows_the_tracked_target_by_the_estimate(flight: FlightParams) -> None:
    known = rendezvous_scene.estimate(flight)
    q_KN = jnp.asarray(rendezvous_scene.camera_attitude(flight, known))
    q_BN = body_attitude(flight.vehicle.camera_mounting, q_KN)
    memory = initial(flight, LARGE, known, q_BN, np.zeros(3))
    assert float(memory.camera.binning) == 4.0  # nothing is tracked at the start
    time = jnp.asarray(0.0)
    lost = command_camera(Stages(), flight, LARGE, memory, time).camera
    np.testing.assert_array_equal([*lost.corner_px, lost.binning], [*memory.camera.corner_px, memory.camera.binning])
    acquired = replace(memory, pointing=rendezvous_scene.with_acquisition(memory.pointing, acquired=jnp.asarray(True)))
    seen = command_camera(Stages(), flight, LARGE, acquired, time).camera
    # The camera points at the target: the window is around the middle of the frame.
    np.testing.assert_allclose(seen.corner_px + 64.0 * seen.binning, [256.0, 256.0], atol=EXACT)
    unseen = replace(
        acquired, pointing=rendezvous_scene.with_acquisition(acquired.pointing, unseen_time=jnp.asarray(5.0))
    )
    assert float(command_camera(Stages(), flight, LARGE, unseen, time).camera.binning) == 4.0


def test_a_users_window_is_commanded(flight: FlightParams) -> None:
    def lower_right(camera: CameraFormat, time: jnp.ndarray) -> CameraCommand:
        corner = jnp.array([camera.width_px, camera.height_px], jnp.float32) - camera.input_px
        return CameraCommand(corner_px=corner + 0.0 * time.astype(jnp.float32), binning=jnp.float32(1.0))

    memory = initial(flight, LARGE, rendezvous_scene.estimate(flight), np.asarray(IDENTITY), np.zeros(3))
    stages = Stages(detector_window=lower_right)
    after = command_camera(stages, flight, LARGE, memory, jnp.asarray(7.0))
    np.testing.assert_array_equal(after.camera.corner_px, [384.0, 384.0])
