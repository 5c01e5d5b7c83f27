"""Training of the detector's second look, on boxes that the first one names and on true ones that are off a little."""

from typing import Any

import jax
import jax.numpy as jnp

from rpojax.training.detector.giou_loss import generalized_iou
from rpojax.vision.detector import proposal_network
from rpojax.vision.detector.non_maximum_suppression import pairwise_iou
from rpojax.vision.detector.proposal_network import ProposalMaps
from rpojax.vision.detector.refinement_network import NETWORK, boxes_from_channels, crop_boxes

_PROPOSALS = 4
"""Boxes of the first look in each picture."""
_JITTERED_BOXES = 2
"""True boxes beside them."""
_TRUE_BOX_JITTER = 0.12
_PROPOSAL_JITTER = 0.04
"""How far edges are moved, 1 sigma, by the sides of the box."""
_POSITIVE_IOU = 0.25
_NEGATIVE_IOU = 0.15
"""Overlap with a true box from which a box is meant for it, and to which it is wrong."""


def refinement_loss(
    params: dict[str, Any], frozen: Any, key: jax.Array, images: jax.Array, boxes: jax.Array, weight: jax.Array
) -> jax.Array:
    """Loss of the network's parameters; `fixed` are the first look's, and see `descent.Loss`."""
    maps = proposal_network.forward(frozen, images)
    keys = jax.random.split(key, images.shape[0])
    candidates = jax.lax.stop_gradient(jax.vmap(_candidate_boxes)(maps.heatmap, maps.edges, boxes, weight, keys))
    crops, frame = jax.vmap(crop_boxes)(images, candidates)
    raw = NETWORK.apply({"params": params}, crops.reshape(-1, *crops.shape[2:]))
    raw = raw.reshape(*candidates.shape[:2], 5)  # pyright: ignore[reportAttributeAccessIssue]
    edge, good, right = jax.vmap(_image_loss)(raw, frame, candidates, boxes, weight)
    return (2.0 * jnp.sum(edge) + jnp.sum(good)) / jnp.maximum(jnp.sum(right), 1.0)


def _candidate_boxes(
    heat: jax.Array, edges: jax.Array, boxes: jax.Array, weight: jax.Array, key: jax.Array
) -> jax.Array:
    """Boxes (n, 4) to look at in one picture: what the first look names, and true or random ones."""
    keys = jax.random.split(key, 3)
    rows, columns = heat.shape
    named = proposal_network.decode_boxes(ProposalMaps(heatmap=heat, edges=edges), _PROPOSALS).box_px
    size = jnp.array([columns, rows], jnp.float32) * proposal_network.STRIDE
    corner = jax.random.uniform(keys[0], (_JITTERED_BOXES, 2), jnp.float32) * size[None, :]
    side = size[None, :] * jnp.exp(-3.5 * jax.random.uniform(keys[1], (_JITTERED_BOXES, 2), jnp.float32))
    anywhere = jnp.concatenate([corner - 0.5 * side, corner + 0.5 * side], axis=1)
    true = jnp.where((weight[:_JITTERED_BOXES] > 0.0)[:, None], boxes[:_JITTERED_BOXES], anywhere)
    both = jnp.concatenate([named, true])
    sides = jnp.tile(both[:, 2:] - both[:, :2], (1, 2))
    shift = jnp.array([_PROPOSAL_JITTER] * named.shape[0] + [_TRUE_BOX_JITTER] * _JITTERED_BOXES, jnp.float32)[:, None]
    moved = both + shift * sides * jax.random.normal(keys[2], both.shape, jnp.float32)
    return jnp.concatenate([jnp.minimum(moved[:, :2], moved[:, 2:]), jnp.maximum(moved[:, :2], moved[:, 2:])], axis=1)


def _image_loss(
    raw: jax.Array, crop_px: jax.Array, candidates: jax.Array, boxes: jax.Array, weight: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Losses (n,) of edges and of goodness, and 1 for boxes that are meant for a true one."""
    found, logit = boxes_from_channels(raw, crop_px)
    shared = pairwise_iou(candidates, boxes)
    real = jnp.where((weight > 0.0)[None, :], shared, 0.0)
    owner = jax.nn.one_hot(jnp.argmax(real, axis=1), boxes.shape[0], dtype=jnp.float32)
    wanted = owner @ boxes
    best = jnp.max(real, axis=1)
    right = (best >= _POSITIVE_IOU).astype(jnp.float32)
    unsure = jnp.any(jnp.where((weight < 0.0)[None, :], shared, 0.0) > 0.05, axis=1) | (best > _NEGATIVE_IOU)
    counted = jnp.where(unsure, right, 1.0)
    side = jnp.tile(crop_px[:, 2:] - crop_px[:, :2], (1, 2))
    distance = jnp.mean(jnp.abs(found - wanted) / side, axis=-1)
    closeness = generalized_iou(found, wanted)
    goodness = jax.lax.stop_gradient(right * jnp.clip(closeness, 0.0, 1.0))
    cross = -goodness * jax.nn.log_sigmoid(logit) - (1.0 - goodness) * jax.nn.log_sigmoid(-logit)
    return right * (1.0 - closeness + 4.0 * distance), counted * cross, right
