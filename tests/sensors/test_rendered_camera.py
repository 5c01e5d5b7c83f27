"""Frames of the rendered camera by what the detector finds in a window of the frame."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from synthetic_camera_statistics import scene

from rpojax.sensors import rendered_camera
from rpojax.sensors.camera import CameraFrame
from rpojax.sensors.imaging import Imaging
from rpojax.sensors.rendered_camera import Networks
from rpojax.vision.detector.two_stage_detector import Detections
from rpojax.vision.imaging.image_formation import ImageWindow
from rpojax.vision.landmark_network.find_landmarks import FoundLandmarks
from rpojax.vision.landmark_network.network_file import load_network
from rpojax.vision.radiance_field.ray_budget import RaySampling
from rpojax.vision.surface.landmark_file import load_landmarks

SIZE = (320, 240)
SIDE, BINNING = 64, 2.0
CORNER = (40.0, 100.0)
"""The window reaches from (40, 100) to (168, 228) px."""
UNUSED = jnp.zeros(())


def only(**numbers: jax.Array) -> Imaging:
    """Imaging of which some numbers are used."""
    unused = dict.fromkeys(
        ("exposure", "full_well", "read_noise", "blur", "bloom_radius", "fill_light", "score_threshold"), UNUSED
    )
    return Imaging(**(unused | numbers))


def frame(
    monkeypatch: pytest.MonkeyPatch,
    box: tuple[float, float, float, float],
    corner: tuple[float, float] = CORNER,
    score: float = 0.6,
    true_edges: tuple[float, float, float, float] = (90.0, 140.0, 130.0, 180.0),
    light: bool = True,
    working: bool = True,
) -> CameraFrame:
    """Frame where the best of two boxes of the detector is `box`, in pixels of the image."""
    boxes = jnp.asarray([[box, (0.0, 0.0, 1.0, 1.0)]], jnp.float32)
    found = Detections(box_px=boxes, score=jnp.asarray([[score, 0.1]], jnp.float32))
    monkeypatch.setattr(rendered_camera, "detect", lambda *_: found)
    imaging = only(score_threshold=jnp.asarray(0.5))
    window = ImageWindow(
        intrinsics=None,
        corner_px=jnp.asarray(corner, jnp.float32),
        binning=jnp.asarray(BINNING, jnp.float32),
    )
    return rendered_camera.measure(
        imaging,
        Networks(field=None, detector={}, sky=None),
        window,
        jnp.zeros((SIDE, SIDE, 3), jnp.float32),
        SIZE,
        jnp.asarray(true_edges),
        jnp.asarray(light),
        jnp.asarray(working),
    )


def test_a_box_of_the_image_is_one_of_the_frame_by_corner_and_binning(monkeypatch: pytest.MonkeyPatch) -> None:
    found = frame(monkeypatch, (25.0, 20.0, 45.5, 41.0))
    np.testing.assert_allclose(found.box.edges, [90.0, 140.0, 131.0, 182.0])
    np.testing.assert_allclose(found.window, [*CORNER, SIDE * BINNING])
    np.testing.assert_allclose(found.outline, [90.0, 140.0, 130.0, 180.0])
    assert found.box.edges.dtype == jnp.float64
    assert bool(found.box.present)
    assert bool(found.observable)
    assert not bool(found.outlier)
    np.testing.assert_allclose(found.score, 0.6, rtol=1e-6)


@pytest.mark.parametrize(
    ("box", "corner", "truncated"),
    [
        ((1.5, 1.5, 62.5, 62.5), CORNER, False),
        ((0.5, 20.0, 40.0, 40.0), CORNER, True),
        ((20.0, 0.5, 40.0, 40.0), CORNER, True),
        ((20.0, 20.0, 63.5, 40.0), CORNER, True),
        ((20.0, 20.0, 40.0, 63.5), CORNER, True),
        # The frame ends within the window: right of 320 px, below 240 px.
        ((20.0, 20.0, 58.5, 40.0), (200.0, 100.0), False),
        ((20.0, 20.0, 59.5, 40.0), (200.0, 100.0), True),
        ((20.0, 20.0, 40.0, 48.5), (100.0, 140.0), False),
        ((20.0, 20.0, 40.0, 49.5), (100.0, 140.0), True),
    ],
)
def test_a_box_within_a_pixel_of_the_image_of_its_border_is_truncated(
    monkeypatch: pytest.MonkeyPatch,
    box: tuple[float, float, float, float],
    corner: tuple[float, float],
    truncated: bool,
) -> None:
    assert bool(frame(monkeypatch, box, corner).box.truncated) == truncated


def test_edges_and_outline_stay_in_the_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    found = frame(monkeypatch, (20.0, 20.0, 63.0, 63.0), (260.0, 180.0), true_edges=(-10.0, 200.0, 330.0, 250.0))
    np.testing.assert_allclose(found.box.edges, [300.0, 220.0, 320.0, 240.0])
    np.testing.assert_allclose(found.outline, [0.0, 200.0, 320.0, 240.0])


@pytest.mark.parametrize(
    ("box", "outlier"),
    [
        # Squares of 40 px, 32.5 and 33 px apart: 7.5 and 7 of 72.5 and 73 px in common.
        ((41.25, 20.0, 61.25, 40.0), False),
        ((41.5, 20.0, 61.5, 40.0), True),
    ],
)
def test_a_box_that_hardly_overlaps_the_outline_is_false(
    monkeypatch: pytest.MonkeyPatch, box: tuple[float, float, float, float], outlier: bool
) -> None:
    found = frame(monkeypatch, box)
    assert bool(found.box.present)
    assert bool(found.outlier) == outlier


@pytest.mark.parametrize(
    ("score", "light", "working", "present", "told"),
    [
        (0.5, True, True, True, 0.5),
        (0.49, True, True, False, 0.49),
        (0.9, False, True, False, 0.9),
        (0.9, True, False, False, 0.0),
    ],
)
def test_there_is_a_box_by_score_light_and_a_working_camera(
    monkeypatch: pytest.MonkeyPatch, score: float, light: bool, working: bool, present: bool, told: float
) -> None:
    false_box = (0.0, 0.0, 5.0, 5.0)
    found = frame(monkeypatch, false_box, score=score, light=light, working=working)
    assert bool(found.box.present) == bool(found.outlier) == present
    assert bool(found.observable) == light
    np.testing.assert_allclose(found.score, told, rtol=1e-6)


def test_an_image_is_black_where_its_window_goes_beyond_the_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    width, height = 100, 60
    side = rendered_camera.input_side(width, height)
    seen = {}

    def white(*arguments: object) -> jax.Array:
        seen["exposure"], seen["noise"] = arguments[2], arguments[-2]
        return jnp.ones((side, side, 3), jnp.float32)

    monkeypatch.setattr(rendered_camera, "form_image", white)
    imaging = only(
        exposure=jnp.asarray(1.5),
        full_well=jnp.asarray(2e4),
        read_noise=jnp.asarray(12.0),
        blur=jnp.asarray(0.7),
        fill_light=jnp.asarray(0.1),
    )
    corner = jnp.asarray([70.0, 20.0], jnp.float32)
    window = ImageWindow(intrinsics=None, corner_px=corner, binning=jnp.asarray(BINNING, jnp.float32))
    networks = Networks(field=None, detector={}, sky=None)
    image = rendered_camera.render_window(
        imaging, networks, RaySampling(8, 64), window, width, height, scene(), jax.random.PRNGKey(0)
    )
    # From 70 px on 15 pixels of 2 px are left of the border, and 20 above it.
    expected = np.zeros((side, side, 3))
    expected[:20, :15] = 1.0
    np.testing.assert_array_equal(image, expected)
    exposure, noise = seen["exposure"], np.asarray(seen["noise"])
    np.testing.assert_allclose(
        [exposure.gain, exposure.full_well, exposure.read_noise, exposure.blur], [1.5, 2e4, 12.0, 0.7]
    )
    assert noise.shape == (side, side, 3)
    assert abs(noise.mean()) < 0.05
    assert abs(noise.std() - 1.0) < 0.05


def test_landmarks_of_the_image_are_those_of_the_frame_by_corner_and_binning() -> None:
    image = jnp.asarray(np.random.default_rng(3).uniform(size=(SIDE, SIDE, 3)), jnp.float32)
    networks = Networks(field=None, detector={}, sky=None, landmarks=load_network(load_landmarks()[0])[0])
    find = jax.jit(rendered_camera.landmarks_in_picture, static_argnums=4)

    def found(corner: tuple[float, float], binning: float) -> FoundLandmarks:
        corner_px = jnp.asarray(corner, jnp.float32)
        window = ImageWindow(intrinsics=None, corner_px=corner_px, binning=jnp.asarray(binning, jnp.float32))
        box = jnp.array([10.0, 12.0, 50.0, 55.0]) * binning + jnp.array([*corner, *corner])
        return find(networks, window, image, box, SIZE)

    alone, in_frame = found((0.0, 0.0), 1.0), found(CORNER, BINNING)
    np.testing.assert_allclose(in_frame.visible_probability, alone.visible_probability, atol=1e-4)
    np.testing.assert_allclose(in_frame.places, np.array(CORNER) + BINNING * np.asarray(alone.places), atol=1e-2)
    np.testing.assert_allclose(in_frame.covariance, BINNING**2 * np.asarray(alone.covariance), rtol=1e-2)


def soft_frame(
    monkeypatch: pytest.MonkeyPatch, true_edges: jax.Array, log_odds: jax.Array, threshold: float, light: bool = True
) -> CameraFrame:
    """Frame of a soft detector of temperature 0.5 whose box is (10, 10, 20, 30) px of the image."""
    box = jnp.array([10.0, 10.0, 20.0, 30.0], jnp.float32)
    monkeypatch.setattr(rendered_camera, "soft_detect", lambda *_: (box, log_odds))
    imaging = only(score_threshold=jnp.asarray(threshold))
    window = ImageWindow(
        intrinsics=None, corner_px=jnp.asarray(CORNER, jnp.float32), binning=jnp.asarray(BINNING, jnp.float32)
    )
    image = jnp.zeros((SIDE, SIDE, 3), jnp.float32)
    networks = Networks(field=None, detector={}, sky=None)
    flags = jnp.asarray(light), jnp.asarray(True)
    return rendered_camera.measure(imaging, networks, window, image, SIZE, true_edges, *flags, 0.5)


def test_a_soft_box_has_the_hard_value_and_moves_with_the_outline(monkeypatch: pytest.MonkeyPatch) -> None:
    edges, odds = jnp.array([90.0, 140.0, 130.0, 180.0]), jnp.asarray(1.0, jnp.float32)
    found = soft_frame(monkeypatch, edges, odds, 0.5)
    np.testing.assert_allclose(found.box.edges, frame(monkeypatch, (10.0, 10.0, 20.0, 30.0)).box.edges)
    moved = jax.jacfwd(lambda each: soft_frame(monkeypatch, each, odds, 0.5).box.edges)(edges)
    np.testing.assert_array_equal(moved, np.eye(4))


def test_a_soft_score_weighs_the_box_by_the_threshold(monkeypatch: pytest.MonkeyPatch) -> None:
    edges = jnp.array([90.0, 140.0, 130.0, 180.0])
    for log_odds, threshold in ((1.0, 0.5), (1.0, 0.8), (-2.0, 0.5)):
        found = soft_frame(monkeypatch, edges, jnp.asarray(log_odds, jnp.float32), threshold)
        margin = log_odds - np.log(threshold / (1.0 - threshold))
        np.testing.assert_allclose(found.weight, 1.0 / (1.0 + np.exp(-margin / 0.5)), rtol=1e-6)
        assert bool(found.box.present) == (margin > 0.0)
        np.testing.assert_allclose(found.score, 1.0 / (1.0 + np.exp(-log_odds)), rtol=1e-6)
    assert float(soft_frame(monkeypatch, edges, jnp.asarray(1.0, jnp.float32), 0.5, light=False).weight) == 0.0


def test_a_box_that_is_decided_has_no_weight(monkeypatch: pytest.MonkeyPatch) -> None:
    assert frame(monkeypatch, (10.0, 10.0, 20.0, 30.0)).weight is None
