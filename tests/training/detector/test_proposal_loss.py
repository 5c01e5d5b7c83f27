"""Loss of the proposal network for perfect_channels and wrong maps."""

import jax
import numpy as np

from rpojax.training.detector import proposal_loss
from rpojax.training.detector.augmentation import Batch
from rpojax.vision.detector.box_decoding import STRIDE

maps_loss, mask_loss = jax.jit(proposal_loss.maps_loss), jax.jit(proposal_loss.mask_loss)
covered_fraction = jax.jit(proposal_loss.covered_fraction, static_argnums=1)


def perfect_channels(box: np.ndarray, cells: int = 32) -> np.ndarray:
    """Channels (1, y, x, 5) with one box at every cell, and heat only at its centre."""
    raw = np.zeros((1, cells, cells, 5), np.float32)
    place = (np.arange(cells) + 0.5) * STRIDE
    raw[..., 0] = -12.0
    center = 0.5 * (box[:2] + box[2:])
    raw[0, int(center[1] // STRIDE), int(center[0] // STRIDE), 0] = 12.0
    for channel, (edge, sign) in enumerate(zip(box, (-1, -1, 1, 1), strict=True)):
        distance = sign * (edge - place) / STRIDE
        raw[0, :, :, 1 + channel] = np.arcsinh(distance[None, :] if channel % 2 == 0 else distance[:, None])
    return raw


def labelled(box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (1, 8, 4) of an image with one box, and their weights."""
    boxes, weight = np.zeros((1, 8, 4), np.float32), np.zeros((1, 8), np.float32)
    boxes[0, 0], weight[0, 0] = box, 1.0
    return boxes, weight


def loss(raw: np.ndarray, boxes: np.ndarray, weight: np.ndarray, known: float = 1.0) -> jax.Array:
    """Loss of channels for boxes with weights; `known` is 1 for edges that count, 0 for others."""
    flags = np.full(boxes.shape, known, np.float32)
    empty = np.zeros((1, 128, 128), np.float32)
    batch = Batch(images=empty[..., None], boxes=boxes, weight=weight, known=flags, mask=empty)
    return maps_loss(raw, batch)


def test_mask_loss_is_small_for_the_covered_cells_and_zero_where_nobody_knows() -> None:
    mask = np.zeros((1, 32, 32), np.float32)
    mask[0, 8:16, 4:20] = 1.0
    fraction = np.asarray(covered_fraction(mask, 4))
    assert fraction.shape == (1, 8, 8)
    assert fraction.sum() == 8.0
    right = np.float32(20.0) * (np.float32(2.0) * fraction - np.float32(1.0))
    assert float(mask_loss(right, fraction)) < 1e-6
    assert float(mask_loss(-right, fraction)) > 30.0
    assert float(mask_loss(-right, np.full_like(fraction, -1.0))) == 0.0


def test_edges_not_known_have_no_loss() -> None:
    box = np.array([20.5, 33.0, 61.0, 52.25])
    boxes, weight = labelled(box)
    shifted = perfect_channels(box)
    shifted[..., 1:] += 0.3
    assert float(loss(shifted, boxes, weight)) > 0.5
    assert float(loss(shifted, boxes, weight, known=0.0)) < 0.01


def test_proposal_loss_is_zero_for_perfect_maps_only() -> None:
    box = np.array([20.5, 33.0, 61.0, 52.25])
    boxes, weight = labelled(box)
    raw = perfect_channels(box)
    best = float(loss(raw, boxes, weight))
    assert best < 0.01
    shifted = raw.copy()
    shifted[..., 1] += 0.05
    cold, alarmed = raw.copy(), raw.copy()
    cold[..., 0] = -12.0
    alarmed[0, 28, 28, 0] = 3.0
    for fault in (shifted, cold, alarmed):
        assert float(loss(fault, boxes, weight)) > best + 0.02
    # Heat on an ignored box has no loss; heat without a box has.
    ignored = np.where(weight > 0.0, -1.0, 0.0).astype(np.float32)
    assert float(loss(raw, boxes, ignored)) < 0.01
    assert float(loss(raw, boxes, np.zeros_like(weight))) > 5.0
