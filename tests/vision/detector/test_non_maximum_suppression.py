"""Non-maximum suppression against a worked case."""

import jax.numpy as jnp
import numpy as np

from rpojax.vision.detector.non_maximum_suppression import suppress_overlapping


def test_first_of_overlapping_boxes_is_kept() -> None:
    boxes = jnp.asarray([[0.0, 0.0, 10.0, 10.0], [1.0, 0.0, 11.0, 10.0], [20.0, 0.0, 30.0, 10.0]])
    np.testing.assert_allclose(suppress_overlapping(boxes, jnp.asarray([0.9, 0.8, 0.1]), 0.5), [0.9, 0.0, 0.1])
