"""Loss of the refinement network, on boxes of the proposal network and on jittered true boxes."""

from typing import Any

import jax
import jax.numpy as jnp

from rpojax.training.detector.augmentation import Batch
from rpojax.training.detector.proposal_loss import with_unknown_edges
from rpojax.vision.detector import box_decoding, proposal_network
from rpojax.vision.detector.box_decoding import ProposalMaps
from rpojax.vision.detector.refinement_network import NETWORK, boxes_from_channels
from rpojax.vision.detector.region_crop import crop_boxes
from rpojax.vision.intersection_over_union import generalized_iou, pairwise_iou

_PROPOSALS = 4
"""Boxes of the proposal network per image."""
_JITTERED_BOXES = 2
"""Jittered true boxes per image."""
_TRUE_BOX_JITTER = 0.12
_PROPOSAL_JITTER = 0.04
"""Displacement of the edges, 1 sigma, by the sides of the box."""
_POSITIVE_IOU = 0.25
_NEGATIVE_IOU = 0.15
"""IoU with a true box from which a candidate is positive, and up to which it is negative."""


def refinement_loss(params: dict[str, Any], frozen: Any, key: jax.Array, batch: Batch) -> jax.Array:
    """Loss of the network's parameters; `frozen` are those of the proposal network, see `training_loop.Loss`."""
    maps = proposal_network.forward(frozen, batch.images)
    keys = jax.random.split(key, batch.images.shape[0])
    candidates = jax.lax.stop_gradient(
        jax.vmap(_candidate_boxes)(maps.heatmap, maps.edges, batch.boxes, batch.weight, keys)
    )
    crops, crop_px = jax.vmap(crop_boxes)(batch.images, candidates)
    raw = NETWORK.apply({"params": params}, crops.reshape(-1, *crops.shape[2:]))
    raw = raw.reshape(*candidates.shape[:2], 5)  # pyright: ignore[reportAttributeAccessIssue]
    edge, quality, positive = jax.vmap(_image_loss)(raw, crop_px, candidates, batch.boxes, batch.weight, batch.known)
    return (2.0 * jnp.sum(edge) + jnp.sum(quality)) / jnp.maximum(jnp.sum(positive), 1.0)


def _candidate_boxes(
    heat: jax.Array, edges: jax.Array, boxes: jax.Array, weight: jax.Array, key: jax.Array
) -> jax.Array:
    """Boxes (n, 4) to refine in one image: proposals, and true or, without a true one, random boxes, all jittered."""
    keys = jax.random.split(key, 3)
    rows, columns = heat.shape
    proposals = box_decoding.decode_boxes(ProposalMaps(heatmap=heat, edges=edges), _PROPOSALS).box_px
    size = jnp.array([columns, rows], jnp.float32) * box_decoding.STRIDE
    corner = jax.random.uniform(keys[0], (_JITTERED_BOXES, 2), jnp.float32) * size[None, :]
    side = size[None, :] * jnp.exp(-3.5 * jax.random.uniform(keys[1], (_JITTERED_BOXES, 2), jnp.float32))
    random = jnp.concatenate([corner - 0.5 * side, corner + 0.5 * side], axis=1)
    true = jnp.where((weight[:_JITTERED_BOXES] > 0.0)[:, None], boxes[:_JITTERED_BOXES], random)
    both = jnp.concatenate([proposals, true])
    sides = jnp.tile(both[:, 2:] - both[:, :2], (1, 2))
    shift = jnp.array([_PROPOSAL_JITTER] * proposals.shape[0] + [_TRUE_BOX_JITTER] * _JITTERED_BOXES, jnp.float32)[
        :, None
    ]
    moved = both + shift * sides * jax.random.normal(keys[2], both.shape, jnp.float32)
    return jnp.concatenate([jnp.minimum(moved[:, :2], moved[:, 2:]), jnp.maximum(moved[:, :2], moved[:, 2:])], axis=1)


def _image_loss(
    raw: jax.Array,
    crop_px: jax.Array,
    candidates: jax.Array,
    boxes: jax.Array,
    weight: jax.Array,
    known: jax.Array,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Losses (n,) of edges and of quality, and 1 for positive candidates."""
    found, logit = boxes_from_channels(raw, crop_px)
    iou = pairwise_iou(candidates, boxes)
    true_iou = jnp.where((weight > 0.0)[None, :], iou, 0.0)
    owner = jax.nn.one_hot(jnp.argmax(true_iou, axis=1), boxes.shape[0], dtype=jnp.float32)
    target_box, shown = owner @ boxes, owner @ known
    best = jnp.max(true_iou, axis=1)
    positive = (best >= _POSITIVE_IOU).astype(jnp.float32)
    uncertain = jnp.any(jnp.where((weight < 0.0)[None, :], iou, 0.0) > 0.05, axis=1) | (best > _NEGATIVE_IOU)
    counted = jnp.where(uncertain, positive, 1.0)
    side = jnp.tile(crop_px[:, 2:] - crop_px[:, :2], (1, 2))
    distance = jnp.mean(shown * jnp.abs(found - target_box) / side, axis=-1)
    giou = generalized_iou(found, with_unknown_edges(target_box, found, shown))
    quality = jax.lax.stop_gradient(positive * jnp.clip(generalized_iou(found, target_box), 0.0, 1.0))
    cross_entropy = -quality * jax.nn.log_sigmoid(logit) - (1.0 - quality) * jax.nn.log_sigmoid(-logit)
    return positive * (1.0 - giou + 4.0 * distance), counted * cross_entropy, positive
