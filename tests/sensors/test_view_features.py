"""Features of a view."""

import jax.numpy as jnp
import numpy as np
import pytest
from synthetic_camera_statistics import scene

from rpojax.sensors import view_features
from rpojax.vision.imaging.image_formation import Scene

OUTLINE = np.array([40.0, 50.0, 80.0, 74.0], np.float32)  # 40 x 24 px, geometric mean 31 px


def test_features_include_an_earth_background_and_its_light() -> None:
    size = (128, 128)
    # The camera is above the x axis of N; its boresight is +z of the target, here also of N.
    space = view_features.features(scene(), jnp.asarray(OUTLINE), size)
    turned = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], np.float32)
    down = view_features.features(Scene(**{**vars(scene()), "R_KN": jnp.asarray(turned)}), jnp.asarray(OUTLINE), size)
    np.testing.assert_allclose(space[16:18], [0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(down[16:18], [1.0, 1.0], atol=1e-3)


def test_features_of_the_outline_are_those_of_its_part_in_the_frame() -> None:
    # 128 x 96 px; of an outline of 40 x 24 px, a quarter of the width and two thirds of the height are in the frame.
    cut = np.array([118.0, -8.0, 158.0, 16.0], np.float32)
    found = view_features.features(scene(), jnp.asarray(cut), (128, 96))
    np.testing.assert_allclose(found[:3], [0.0, 0.0, -1.0], atol=1e-6)
    np.testing.assert_allclose(found[3:9], [1.0, 0.0, 0.0, 1.0, 0.0, 0.0], atol=1e-6)
    visible_width, visible_height = 10.0, 16.0
    expected = [
        0.0,
        1.0,
        0.0,
        0.5 * np.log(visible_width * visible_height),
        np.log(40.0 / 24.0),
        visible_width * visible_height / (40.0 * 24.0),
        1.0,
    ]
    np.testing.assert_allclose(found[9:16], expected, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(found[18:20], [(123.0 - 64.0) / 64.0, (8.0 - 48.0) / 48.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("outline", "expected"),
    [
        ((120.0, 20.0, 121.1, 21.0), True),
        ((120.0, 20.0, 120.9, 21.0), False),
        ((127.0, 90.0, 160.0, 91.1), True),
        ((127.0, 90.0, 160.0, 90.9), False),
        ((130.0, 20.0, 160.0, 40.0), False),
        ((20.0, -30.0, 40.0, -10.0), False),
    ],
)
def test_a_target_is_in_the_frame_with_more_than_a_square_pixel_of_its_outline(
    outline: tuple[float, ...], expected: bool
) -> None:
    assert bool(view_features.is_in_frame(jnp.asarray(outline, jnp.float32), (128, 96))) == expected
