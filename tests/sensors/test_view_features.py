"""Features of a view."""

import jax.numpy as jnp
import numpy as np
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
