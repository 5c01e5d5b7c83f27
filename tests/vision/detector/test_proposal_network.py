"""Maps of the proposal network."""

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.vision.detector import proposal_network

initialize, forward = jax.jit(proposal_network.initialize), jax.jit(proposal_network.forward)


def test_batch_equals_single_images() -> None:
    params = initialize(jax.random.key(0))
    images = np.random.default_rng(1).random((3, 64, 96, 3), np.float32)
    maps, features = forward(params, images)
    assert features.shape == (3, 16, 24, proposal_network.FEATURES)
    assert maps.heatmap.shape == (3, 16, 24)
    assert maps.heatmap.dtype == maps.edges.dtype == jnp.float32
    one, _ = forward(params, images[1:2])
    np.testing.assert_allclose(maps.edges[1], one.edges[0], atol=1e-3)
    mapped = jax.jit(jax.vmap(lambda image: proposal_network.forward(params, image[None])[0]))(images)
    np.testing.assert_allclose(mapped.heatmap[:, 0], maps.heatmap, atol=1e-4)
