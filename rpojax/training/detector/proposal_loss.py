"""Loss of the proposal network: focal loss of the heatmap, GIoU and distance loss of the edges, and of the mask."""

from typing import Any

import jax
import jax.numpy as jnp

from rpojax.training.detector.augmentation import Batch
from rpojax.vision.detector.box_decoding import STRIDE, maps_from_channels
from rpojax.vision.detector.proposal_network import NETWORK
from rpojax.vision.intersection_over_union import generalized_iou

_HEAT_SIGMA_FRACTION = 0.12
_MIN_HEAT_SIGMA_PX = 2.0
_MIN_EDGE_HEAT = 0.3
_MASK_WEIGHT = 1.0


def proposal_loss(params: dict[str, Any], frozen: Any, key: jax.Array, batch: Batch) -> jax.Array:
    """Loss of the network's parameters; see `training_steps.Loss`."""
    del frozen, key
    result: Any = NETWORK.apply({"params": params}, batch.images)
    raw, _, mask = result
    return maps_loss(raw, batch) + _MASK_WEIGHT * mask_loss(mask[..., 0], covered_fraction(batch.mask, STRIDE))


def covered_fraction(mask: Any, stride: int) -> jax.Array:
    """Mean (n, y, x) of masks (n, p, p) over cells of `stride` pixels; a mask of -1 stays so."""
    count, height, width = mask.shape
    return jnp.mean(mask.reshape(count, height // stride, stride, width // stride, stride), axis=(2, 4))


def mask_loss(logit: jax.Array, fraction: jax.Array) -> jax.Array:
    """Cross-entropy of covered fractions (n, y, x) per cell, which counts spacecraft and background alike."""
    counted = jnp.where(fraction >= 0.0, 1.0, 0.0).astype(jnp.float32)
    target = jnp.clip(fraction, 0.0, 1.0)
    entropy = -target * jax.nn.log_sigmoid(logit) - (1.0 - target) * jax.nn.log_sigmoid(-logit)
    covered, free = counted * target, counted * (1.0 - target)
    means = [jnp.sum(part * entropy) / jnp.maximum(jnp.sum(part), 1.0) for part in (covered, free)]
    return means[0] + means[1]


def maps_loss(raw: jax.Array, batch: Batch) -> jax.Array:
    """Loss of the network's channels (n, y, x, 5) for the boxes of a batch."""
    maps = maps_from_channels(raw)
    heat, edges = jax.vmap(_image_loss)(maps.heatmap, maps.edges, raw[..., 1:], batch.boxes, batch.weight, batch.known)
    count = jnp.maximum(jnp.sum(jnp.where(batch.weight > 0.0, 1.0, 0.0).astype(jnp.float32)), 1.0)
    return (jnp.sum(heat) + 2.0 * jnp.sum(edges)) / count


def _image_loss(
    heat: jax.Array, edges: jax.Array, raw: jax.Array, boxes: jax.Array, weight: jax.Array, known: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Sums over the cells of an image of the heat loss and of the edge loss."""
    rows, columns = heat.shape
    x = ((jnp.arange(columns, dtype=jnp.float32) + 0.5) * STRIDE)[None, :]
    y = ((jnp.arange(rows, dtype=jnp.float32) + 0.5) * STRIDE)[None, :]
    left, top, right, bottom = (boxes[:, i, None] for i in range(4))
    # For each axis (m, cells): a Gaussian, the cell of the centre, and the cells that the box covers.
    gaussians, centers, covers = [], [], []
    for place, low, high in ((x, left, right), (y, top, bottom)):
        offset = place - 0.5 * (low + high)
        sigma = jnp.maximum(_HEAT_SIGMA_FRACTION * (high - low), _MIN_HEAT_SIGMA_PX)
        gaussians.append(jnp.exp(-0.5 * (offset / sigma) ** 2))
        centers.append((offset >= -0.5 * STRIDE) & (offset < 0.5 * STRIDE))
        covers.append((place > low - STRIDE) & (place < high + STRIDE))
    labelled, ignored = (weight > 0.0)[:, None, None], (weight < 0.0)[:, None, None]
    near = jnp.where(labelled, gaussians[1][:, :, None] * gaussians[0][:, None, :], 0.0)
    inside = centers[1][:, :, None] & centers[0][:, None, :] & labelled
    positive = jnp.any(inside, axis=0)
    skipped = jnp.any(covers[1][:, :, None] & covers[0][:, None, :] & ignored, axis=0) & ~positive
    target = jnp.max(near, axis=0)
    heat_loss = jnp.where(skipped, 0.0, _focal_loss(heat, target, positive))
    # Each cell learns the edges of the box with the nearest centre.
    near = jnp.where(inside, 1.0, near)
    owner = jax.nn.one_hot(jnp.argmax(near, axis=0), boxes.shape[0], axis=0, dtype=jnp.float32)
    edge_weight = owner * jnp.where(near >= _MIN_EDGE_HEAT, near, 0.0)
    edge_weight = jnp.sum(edge_weight / jnp.maximum(jnp.sum(edge_weight, axis=(1, 2), keepdims=True), 1e-6), axis=0)
    target_box = jnp.einsum("myx,mc->yxc", owner, boxes)
    cell_center = jnp.stack(jnp.broadcast_arrays(x, y.T, x, y.T), axis=-1)
    sign = jnp.array([-1.0, -1.0, 1.0, 1.0], jnp.float32)[None, None, :]
    shown = jnp.einsum("myx,mc->yxc", owner, known)
    distance = jnp.mean(shown * jnp.abs(raw - jnp.arcsinh(sign * (target_box - cell_center) / STRIDE)), axis=-1)
    edge_loss = (1.0 - generalized_iou(edges, with_unknown_edges(target_box, edges, shown))) + distance
    return jnp.sum(heat_loss), jnp.sum(edge_weight * edge_loss)


def with_unknown_edges(target: jax.Array, found: jax.Array, known: jax.Array) -> jax.Array:
    """True boxes (..., 4) with the edges found in place of those not known (..., 4), which then have no loss."""
    return jnp.where(known > 0.0, target, jax.lax.stop_gradient(found))


def _focal_loss(logit: jax.Array, target: jax.Array, positive: jax.Array) -> jax.Array:
    """Focal loss of the heatmap (Zhou et al., 2019, eq. 1): wrong heat counts less the nearer it is to a centre."""
    p = jax.nn.sigmoid(logit)
    right = -((1.0 - p) ** 2) * jax.nn.log_sigmoid(logit)
    wrong = -((1.0 - target) ** 4) * p * p * jax.nn.log_sigmoid(-logit)
    return jnp.where(positive, right, wrong)
