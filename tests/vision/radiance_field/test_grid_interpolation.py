"""Trilinear interpolation of the grid reproduces linear functions."""

import jax.numpy as jnp
import numpy as np

from rpojax.vision.radiance_field.grid_field import LATENT_SIZE, GridField, number_near_nodes
from rpojax.vision.radiance_field.grid_interpolation import interpolate_features, trilinear_nodes


def test_linear_features_are_interpolated_exactly() -> None:
    shape = (4, 5, 3)
    nodes = np.argwhere(np.ones(shape, bool))
    features = np.zeros((len(nodes) + 1, 3 + LATENT_SIZE), np.float32)
    features[1:, 0] = nodes @ [1.0, -2.0, 0.5] + 3.0
    field = GridField(
        low=jnp.asarray([0.5, 0.0, -1.0], jnp.float32),
        spacing=jnp.float32(0.1),
        node_row=jnp.asarray(number_near_nodes(np.ones(shape, bool))),
        occupancy=jnp.zeros(shape, jnp.float32),
        raw_density=jnp.zeros(len(features), jnp.float32),
        features=jnp.asarray(features),
        network=(),
        material=(),
        fill_network=(),
    )
    place = np.array([2.25, 3.5, 0.125])
    rows, weights = trilinear_nodes(field, jnp.asarray(np.asarray(field.low) + 0.1 * place, jnp.float32))
    found = interpolate_features(field, rows, weights)[0]
    np.testing.assert_allclose(found, place @ [1.0, -2.0, 0.5] + 3.0, atol=1e-4)
