"""Selection of the window of large frames."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.sensors import window_selection
from rpojax.vision import pinhole
from rpojax.vision.imaging.image_formation import ImageWindow
from rpojax.vision.pinhole import Intrinsics

EXACT = 1e-3  # pixels, in single precision


def large() -> Intrinsics:
    """Intrinsics of a camera of 512 px."""
    return pinhole.pinhole_intrinsics(jnp.asarray(np.radians(10.0)), 512, 512)


def chosen(expected: tuple[float, float], size: float, tracked: bool, side: int = 512) -> ImageWindow:
    optics = pinhole.pinhole_intrinsics(jnp.asarray(np.radians(10.0)), side, side)
    return window_selection.choose_window(
        optics, side, side, jnp.asarray(expected), jnp.asarray(size), jnp.asarray(tracked)
    )


@pytest.mark.parametrize(("side", "expected"), [(64, 64), (100, 128), (128, 128), (256, 128), (1024, 128)])
def test_the_detector_input_is_the_frame_or_a_window_of_128_px(side: int, expected: int) -> None:
    assert window_selection.input_side(side, side) == expected


def test_the_window_of_a_small_frame_is_the_whole_frame() -> None:
    for tracked in (True, False):
        view = chosen((100.0, 20.0), 30.0, tracked, side=128)
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
    assert 150.0 / float(view.binning) == pytest.approx(window_selection.TARGET_FRACTION * 128.0, abs=EXACT)


def test_pixels_of_a_window_map_to_those_of_the_frame() -> None:
    view = chosen((300.0, 200.0), 100.0, True)
    points = jnp.asarray([[0.3, -0.2, 30.0], [1.0, 1.5, 28.0]])
    whole = np.asarray(pinhole.project(large(), points))
    own = np.asarray(pinhole.project(jax.tree.map(lambda v: v.astype(jnp.float64), view.intrinsics), points))
    found = np.asarray(view.corner_px)[:, None] + own * float(view.binning)
    np.testing.assert_allclose(found, whole, atol=0.01)
