"""Loss of the landmark network: places by their own covariance, heat maps, and who is in sight."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.training.pose.random_crops import CropBatch
from rpojax.vision.landmark_network.landmark_crop import crop_channels
from rpojax.vision.landmark_network.network import CELL_PX, MAP_CELLS, LandmarkEstimates, Params, estimate

_HIDDEN_WEIGHT = 0.2
"""Of the places of landmarks behind the target itself; they are inferred from what is seen of it."""
_HEAT_WEIGHT, _VISIBILITY_WEIGHT = 1.0, 1.0
_LARGE_ERROR = 4.0
"""Error by its own covariance from which on its loss grows in proportion to it instead of its square."""


def landmark_loss(params: Params, labelled: CropBatch) -> Array:
    """Mean loss over the landmarks of a batch."""
    found = estimate(params, crops_of(labelled))
    weight = labelled.visible + _HIDDEN_WEIGHT * (labelled.in_crop - labelled.visible)
    total = jnp.maximum(jnp.sum(weight), 1.0)
    place = jnp.sum(weight * negative_log_likelihood(found.places, found.roots, labelled.places)) / total
    heat = jnp.sum(weight * _heat_cross_entropy(found, labelled.places)) / total
    logit, visible = found.visible_logit, labelled.visible
    sight = jnp.mean(-visible * jax.nn.log_sigmoid(logit) - (1.0 - visible) * jax.nn.log_sigmoid(-logit))
    return place + _HEAT_WEIGHT * heat + _VISIBILITY_WEIGHT * sight


def crops_of(batch: CropBatch) -> Float[Array, "n 96 96 4"]:
    """Crops as a network takes them."""
    return jax.vmap(crop_channels)(
        jnp.asarray(batch.codes).astype(jnp.float32) / 255.0, jnp.asarray(batch.inside).astype(jnp.float32)
    )


def negative_log_likelihood(
    places: Float[Array, "n k 2"], roots: Float[Array, "n k 2 2"], true: Float[Array, "n k 2"]
) -> Float[Array, "n k"]:
    """That of the true places [crop px] under normal distributions, less a constant; linear for large errors."""
    miss = true - places
    first = miss[..., 0] / roots[..., 0, 0]
    second = (miss[..., 1] - roots[..., 1, 0] * first) / roots[..., 1, 1]
    square = first**2 + second**2
    length = jnp.sqrt(square + 1e-12)
    tempered = jnp.where(length < _LARGE_ERROR, 0.5 * square, _LARGE_ERROR * (length - 0.5 * _LARGE_ERROR))
    return tempered + jnp.log(roots[..., 0, 0]) + jnp.log(roots[..., 1, 1])


def _heat_cross_entropy(found: LandmarkEstimates, true: Float[Array, "n k 2"]) -> Float[Array, "n k"]:
    """Cross-entropy of heat maps and the four cells around each place, by their closeness."""
    logits = jax.nn.log_softmax(found.heat.reshape(found.heat.shape[0], -1, found.heat.shape[-1]), axis=1)
    logits = logits.reshape(found.heat.shape)
    cell = jnp.clip(true / CELL_PX - 0.5, 0.0, MAP_CELLS - 1.0)
    number = jnp.arange(MAP_CELLS, dtype=jnp.float32)[None, None]
    across, down = (jnp.maximum(0.0, 1.0 - jnp.abs(cell[..., axis, None] - number)) for axis in (0, 1))
    return -jnp.einsum("nky,nkx,nyxk->nk", down, across, logits)
