"""Edges of a box as distributions over places of a crop, with their means as estimates.

After Li et al., "Generalized focal loss", NeurIPS 2020, with places of the crop in place of distances from a centre.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

PLACES = 48
"""Places of an edge along a side of the crop."""
_PRIOR_SIGMA = 0.12
"""Of an edge around that of the box to refine, by the side of the crop."""


def prior_logits(boxes: Float[Array, "n 4"], crop_px: Float[Array, "n 4"]) -> Float[Array, "n 4 48"]:
    """Log-density of the edges before the crop is looked at: each is near that of the box to refine."""
    offset = (place_centers()[None, None, :] - as_fractions(boxes, crop_px)[..., None]) / _PRIOR_SIGMA
    return -0.5 * offset**2


def as_fractions(boxes: Float[Array, "n 4"], crop_px: Float[Array, "n 4"]) -> Float[Array, "n 4"]:
    """Edges by the sides of the crops, 0 at their left or upper edge."""
    corner, side = _corner_and_side(crop_px)
    return (boxes - corner) / side


def mean_boxes(logits: Float[Array, "n 4 48"], crop_px: Float[Array, "n 4"]) -> Float[Array, "n 4"]:
    """Boxes [px] of the means of the distributions in crops with edges `crop_px`."""
    place = jnp.sum(jax.nn.softmax(logits, axis=-1) * place_centers()[None, None, :], axis=-1)
    corner, side = _corner_and_side(crop_px)
    return corner + place * side


def _corner_and_side(crop_px: Float[Array, "n 4"]) -> tuple[Float[Array, "n 4"], Float[Array, "n 4"]]:
    """Left and upper edge of crops, and their width and height, for each of the four edges of a box."""
    return jnp.tile(crop_px[:, :2], (1, 2)), jnp.tile(crop_px[:, 2:] - crop_px[:, :2], (1, 2))


def place_centers() -> Float[Array, " 48"]:
    """Centres of the places by the side of the crop."""
    return (jnp.arange(PLACES, dtype=jnp.float32) + 0.5) / PLACES
