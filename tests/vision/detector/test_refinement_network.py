"""Boxes of the refinement network."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.detector import refinement_network
from rpojax.vision.detector.proposal_network import FEATURES

BOXES = jnp.asarray(np.array([[10.0, 10.0, 30.0, 20.0], [40.0, 5.0, 90.0, 60.0]]), jnp.float32)

initialize = jax.jit(refinement_network.initialize)


@jax.jit
def refine(params: refinement_network.Params, boxes: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Boxes refined in a random image with random maps."""
    image = jax.random.uniform(jax.random.key(1), (64, 96, 3), jnp.float32)
    features = jax.random.uniform(jax.random.key(2), (16, 24, FEATURES), jnp.float32)
    return refinement_network.refine_boxes(params, image, features, boxes)


def test_network_that_sees_nothing_keeps_the_boxes() -> None:
    params = initialize(jax.random.key(0))
    params = {**params, "out": jax.tree.map(np.zeros_like, params["out"])}
    found, _ = refine(params, BOXES)
    np.testing.assert_allclose(found, BOXES, atol=1.0)  # the ends of the crop cut the prior


def test_refinement_of_batch_equals_single_boxes() -> None:
    params = initialize(jax.random.key(0))
    together, logits = refine(params, BOXES)
    for index in range(2):
        alone, logit = refine(params, np.asarray(BOXES)[index : index + 1])
        np.testing.assert_allclose(alone[0], together[index], atol=1e-3)
        assert float(logit[0]) == pytest.approx(float(logits[index]), abs=1e-4)
