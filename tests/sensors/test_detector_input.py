"""Detector input: its size, and the mapping of a window's pixels to those of the frame."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.sensors import detector_input
from rpojax.vision import pinhole


@pytest.mark.parametrize(("side", "expected"), [(64, 64), (100, 128), (128, 128), (256, 128), (1024, 128)])
def test_the_detector_input_is_the_frame_or_a_window_of_128_px(side: int, expected: int) -> None:
    assert detector_input.input_side(side, side) == expected


def test_pixels_of_a_window_map_to_those_of_the_frame() -> None:
    large = pinhole.pinhole_intrinsics(jnp.asarray(np.radians(10.0)), 512, 512)
    view = detector_input.window_at(large, jnp.array([130.5, 60.25], jnp.float32), jnp.float32(1.953))
    points = jnp.asarray([[0.3, -0.2, 30.0], [1.0, 1.5, 28.0]])
    whole = np.asarray(pinhole.project(large, points))
    own = np.asarray(pinhole.project(jax.tree.map(lambda v: v.astype(jnp.float64), view.intrinsics), points))
    found = np.asarray(view.corner_px)[:, None] + own * float(view.binning)
    np.testing.assert_allclose(found, whole, atol=0.01)
