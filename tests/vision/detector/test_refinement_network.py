"""Boxes of the refinement network."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.detector import refinement_network
from rpojax.vision.detector.refinement_network import boxes_from_channels


def test_zero_channels_give_nominal_box() -> None:
    crop_px = jnp.asarray([[10.0, 20.0, 50.0, 100.0]], jnp.float32)
    box, logit = boxes_from_channels(jnp.zeros((1, 5), jnp.float32), crop_px)
    np.testing.assert_allclose(box[0], [18.0, 36.0, 42.0, 84.0], atol=1e-4)
    assert float(logit[0]) == 0.0


def test_refinement_of_batch_equals_single_boxes() -> None:
    params = refinement_network.initialize(jax.random.key(0))
    image = jax.random.uniform(jax.random.key(1), (64, 96, 3), jnp.float32)
    boxes = jnp.asarray([[10.0, 10.0, 30.0, 20.0], [40.0, 5.0, 90.0, 60.0]], jnp.float32)
    together, logits = refinement_network.refine_boxes(params, image, boxes)
    for index in range(2):
        alone, logit = refinement_network.refine_boxes(params, image, boxes[index : index + 1])
        np.testing.assert_allclose(alone[0], together[index], atol=1e-3)
        assert float(logit[0]) == pytest.approx(float(logits[index]), abs=1e-4)
