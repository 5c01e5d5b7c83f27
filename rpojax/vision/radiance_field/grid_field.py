"""Radiance field on a sparse grid: density and features on the nodes near the target's surface."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core.pytree import pytree
from rpojax.vision.multilayer_perceptron import Layers

LATENT_SIZE = 8
"""Features of a node beside its normal, inputs of the shading network."""


@pytree
class GridField:
    """A field on the nodes of a grid that lie near the target's surface.

    Attributes:
        low: (3,) position of the first node [m]
        spacing: () distance of neighbouring nodes [m]
        node_row: (x, y, z) int32, row of a node in the tables; row 0 is empty space
        occupancy: (x, y, z) weight in 0..1 of a cell, named by its lowest node, when samples are placed along a ray
        raw_density: (r,) density before its activation
        features: (r, 3 + LATENT_SIZE) surface normal and latent features
        network: layers of the network of smooth sunlight
        material: linear layer from latent features to mirror colour and roughness
        fill_network: layers of the network of fill light
    """

    low: Array
    spacing: Array
    node_row: Array
    occupancy: Array
    raw_density: Array
    features: Array
    network: Layers
    material: Layers
    fill_network: Layers


def grid_bounds(field: GridField) -> tuple[Array, Array]:
    """Lowest and highest corner (3,) of the grid [m]."""
    return field.low, field.low + field.spacing * (jnp.array(field.node_row.shape, jnp.float32) - 1.0)


def number_near_nodes(near: np.ndarray) -> np.ndarray:
    """Table rows (x, y, z) int32 of nodes: 1, 2, ... for those near the surface, 0 for the others."""
    row = np.zeros(near.shape, np.int32)
    row[near] = 1 + np.arange(int(near.sum()), dtype=np.int32)
    return row
