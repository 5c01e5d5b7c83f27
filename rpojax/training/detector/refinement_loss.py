"""Loss of the refinement network, on boxes of the proposal network and on jittered true boxes."""

from typing import Any

import jax
import jax.numpy as jnp

from rpojax.core.pytree import pytree
from rpojax.training.detector.augmentation import Batch
from rpojax.training.detector.proposal_loss import mask_loss, with_unknown_edges
from rpojax.vision.detector import box_decoding, proposal_network
from rpojax.vision.detector.box_decoding import ProposalMaps
from rpojax.vision.detector.edge_distribution import PLACES, as_fractions, mean_boxes
from rpojax.vision.detector.refinement_network import MASK_CELLS, NETWORK, network_inputs
from rpojax.vision.detector.region_crop import crop_maps
from rpojax.vision.intersection_over_union import generalized_iou, pairwise_iou

_PROPOSALS = 2
"""Boxes of the proposal network per image."""
_JITTERED_BOXES = 2
"""Jittered true boxes per image."""
_JITTERS = (0.03, 0.3)
"""Least and largest displacement of the edges of true boxes, 1 sigma, by the sides of the box."""
_PROPOSAL_JITTER = 0.04
_POSITIVE_IOU = 0.2
_NEGATIVE_IOU = 0.1
"""IoU with a true box from which a candidate is positive, and up to which it is negative."""
_GIOU_WEIGHT, _PLACE_WEIGHT, _MASK_WEIGHT = 2.0, 0.5, 0.5


@pytree
class _Found:
    """What the network gives for the candidates of one image: boxes (n, 4) [px], logits of places and of quality."""

    boxes: jax.Array
    places: jax.Array
    quality: jax.Array


@pytree
class _Labels:
    """Boxes (m, 4) [px], weights (m,) and known edges (m, 4) of one image, as in `Batch`."""

    boxes: jax.Array
    weight: jax.Array
    known: jax.Array


def refinement_loss(params: dict[str, Any], frozen: Any, key: jax.Array, batch: Batch) -> jax.Array:
    """Loss of the network's parameters; `frozen` are those of the proposal network, see `training_steps.Loss`."""
    labels = _Labels(boxes=jnp.asarray(batch.boxes), weight=jnp.asarray(batch.weight), known=jnp.asarray(batch.known))
    maps, features = jax.lax.stop_gradient(proposal_network.forward(frozen, batch.images))
    keys = jax.random.split(key, batch.images.shape[0])
    candidates = jax.lax.stop_gradient(jax.vmap(_candidate_boxes)(maps, labels, keys))
    *inputs, crop_px = jax.vmap(network_inputs)(batch.images, features, candidates)
    covered = jax.vmap(lambda mask, px: crop_maps(mask[..., None], px, 1, MASK_CELLS)[..., 0])(batch.mask, crop_px)
    flat = (values.reshape(-1, *values.shape[2:]) for values in inputs)
    result: Any = NETWORK.apply({"params": params}, *flat)
    places, quality, mask = result
    found = _Found(
        boxes=mean_boxes(places, crop_px.reshape(-1, 4)).reshape(candidates.shape),
        places=places.reshape(*candidates.shape, PLACES),
        quality=quality.reshape(candidates.shape[:2]),
    )
    edge, quality_loss, positive = jax.vmap(_image_loss)(found, crop_px, candidates, labels)
    shown = jnp.where(positive.reshape(-1)[:, None, None] > 0.0, covered.reshape(mask.shape), -1.0)
    count = jnp.maximum(jnp.sum(positive), 1.0)
    return (jnp.sum(edge) + jnp.sum(quality_loss)) / count + _MASK_WEIGHT * mask_loss(mask, shown)


def _candidate_boxes(maps: ProposalMaps, labels: _Labels, key: jax.Array) -> jax.Array:
    """Boxes (n, 4) to refine in an image: jittered proposals and true boxes, or further proposals without true boxes.

    The true boxes are those of two spacecraft, or of one twice. Most that an empty image proposes is cloud, so its
    further proposals are harder to tell from spacecraft than boxes at random places.
    """
    jitter_key, move_key = jax.random.split(key)
    proposals = box_decoding.decode_boxes(maps, _PROPOSALS + _JITTERED_BOXES).box_px
    is_true = labels.weight[:_JITTERED_BOXES] > 0.0
    again = jnp.where(is_true, jnp.arange(_JITTERED_BOXES, dtype=jnp.int32), 0)
    true = jnp.where((labels.weight[again] > 0.0)[:, None], labels.boxes[again], proposals[_PROPOSALS:])
    both = jnp.concatenate([proposals[:_PROPOSALS], true])
    low, high = _JITTERS
    jitter = low * (high / low) ** jax.random.uniform(jitter_key, (_JITTERED_BOXES, 1), jnp.float32)
    shift = jnp.concatenate([jnp.full((_PROPOSALS, 1), _PROPOSAL_JITTER, jnp.float32), jitter])
    moved = both + shift * jnp.tile(both[:, 2:] - both[:, :2], (1, 2)) * jax.random.normal(
        move_key, both.shape, jnp.float32
    )
    return jnp.concatenate([jnp.minimum(moved[:, :2], moved[:, 2:]), jnp.maximum(moved[:, :2], moved[:, 2:])], axis=1)


def _image_loss(
    found: _Found, crop_px: jax.Array, candidates: jax.Array, labels: _Labels
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Losses (n,) of edges and of quality, and 1 for positive candidates."""
    iou = pairwise_iou(candidates, labels.boxes)
    true_iou = jnp.where((labels.weight > 0.0)[None, :], iou, 0.0)
    owner = jax.nn.one_hot(jnp.argmax(true_iou, axis=1), labels.boxes.shape[0], dtype=jnp.float32)
    target, known = owner @ labels.boxes, owner @ labels.known
    best = jnp.max(true_iou, axis=1)
    positive = (best >= _POSITIVE_IOU).astype(jnp.float32)
    ignored = jnp.any(jnp.where((labels.weight < 0.0)[None, :], iou, 0.0) > 0.05, axis=1)
    counted = jnp.where(ignored | (best > _NEGATIVE_IOU), positive, 1.0)
    giou = generalized_iou(found.boxes, with_unknown_edges(target, found.boxes, known))
    place = jnp.sum(known * _place_loss(found.places, as_fractions(target, crop_px)), axis=-1)
    quality = jax.lax.stop_gradient(positive * jnp.clip(generalized_iou(found.boxes, target), 0.0, 1.0))
    cross_entropy = -quality * jax.nn.log_sigmoid(found.quality) - (1.0 - quality) * jax.nn.log_sigmoid(-found.quality)
    return positive * (_GIOU_WEIGHT * (1.0 - giou) + _PLACE_WEIGHT * place), counted * cross_entropy, positive


def _place_loss(logits: jax.Array, fraction: jax.Array) -> jax.Array:
    """Distribution focal loss (n, 4) (Li et al., 2020, eq. 6): cross-entropy of the two places next to an edge."""
    place = jnp.clip(fraction * PLACES - 0.5, 0.0, PLACES - 1.0)[..., None]
    target = jnp.maximum(0.0, 1.0 - jnp.abs(place - jnp.arange(PLACES, dtype=jnp.float32)[None, None, :]))
    return -jnp.sum(target * jax.nn.log_softmax(logits, axis=-1), axis=-1)
