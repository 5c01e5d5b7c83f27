"""Distributions of edges over the places of a crop."""

import jax.numpy as jnp
import numpy as np

from rpojax.vision.detector.edge_distribution import PLACES, as_fractions, mean_boxes, place_centers, prior_logits

CROP_PX = jnp.asarray([[10.0, 20.0, 50.0, 100.0]], jnp.float32)


def test_mean_of_two_neighbouring_places_is_between_them() -> None:
    logits = jnp.full((1, 4, PLACES), -30.0, jnp.float32)
    for edge, first in enumerate((3, 10, 30, 40)):
        logits = logits.at[0, edge, first].set(0.0).at[0, edge, first + 1].set(jnp.log(3.0))
    expected = (np.array([3, 10, 30, 40]) + 0.75 + 0.5) / PLACES
    box = mean_boxes(logits, CROP_PX)
    np.testing.assert_allclose(as_fractions(box, CROP_PX)[0], expected, atol=1e-5)
    np.testing.assert_allclose(box[0], np.array([10, 20, 10, 20]) + expected * np.array([40, 80, 40, 80]), atol=1e-3)


def test_prior_is_densest_at_the_edges_of_the_box() -> None:
    box = jnp.asarray([[20.0, 40.0, 40.0, 80.0]], jnp.float32)
    densest = place_centers()[jnp.argmax(prior_logits(box, CROP_PX), axis=-1)]
    np.testing.assert_allclose(densest[0], [0.25, 0.25, 0.75, 0.75], atol=0.5 / PLACES + 1e-6)
