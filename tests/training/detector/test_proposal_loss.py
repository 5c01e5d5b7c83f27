"""Loss of the proposal network for perfect_channels and wrong maps."""

import jax.numpy as jnp
import numpy as np

from rpojax.training.detector.augmentation import Batch
from rpojax.training.detector.proposal_loss import covered_fraction, maps_loss, mask_loss
from rpojax.vision.detector.box_decoding import STRIDE


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


def loss(raw: jnp.ndarray, boxes: jnp.ndarray, weight: jnp.ndarray, known: float = 1.0) -> jnp.ndarray:
    """Loss of channels for boxes with weights; `known` is 1 for edges that count, 0 for others."""
    flags = np.full(boxes.shape, known, np.float32)
    empty = np.zeros((1, 128, 128), np.float32)
    batch = Batch(images=empty[..., None], boxes=np.asarray(boxes), weight=np.asarray(weight), known=flags, mask=empty)
    return maps_loss(raw, batch)


def test_mask_loss_is_small_for_the_covered_cells_and_zero_where_nobody_knows() -> None:
    mask = np.zeros((1, 32, 32), np.float32)
    mask[0, 8:16, 4:20] = 1.0
    fraction = covered_fraction(jnp.asarray(mask), 4)
    assert fraction.shape == (1, 8, 8)
    assert float(jnp.sum(fraction)) == 8.0
    right = 20.0 * (2.0 * fraction - 1.0)
    assert float(mask_loss(right, fraction)) < 1e-6
    assert float(mask_loss(-right, fraction)) > 30.0
    assert float(mask_loss(-right, jnp.full_like(fraction, -1.0))) == 0.0


def test_edges_not_known_have_no_loss() -> None:
    box = np.array([20.5, 33.0, 61.0, 52.25])
    boxes = jnp.zeros((1, 8, 4), jnp.float32).at[0, 0].set(jnp.asarray(box, jnp.float32))
    weight = jnp.zeros((1, 8), jnp.float32).at[0, 0].set(1.0)
    shifted = perfect_channels(box)
    shifted[..., 1:] += 0.3
    assert float(loss(jnp.asarray(shifted), boxes, weight)) > 0.5
    assert float(loss(jnp.asarray(shifted), boxes, weight, known=0.0)) < 0.01


def test_proposal_loss_is_zero_for_perfect_maps_only() -> None:
    box = np.array([20.5, 33.0, 61.0, 52.25])
    boxes = jnp.zeros((1, 8, 4), jnp.float32).at[0, 0].set(jnp.asarray(box, jnp.float32))
    weight = jnp.zeros((1, 8), jnp.float32).at[0, 0].set(1.0)
    raw = perfect_channels(box)
    best = float(loss(jnp.asarray(raw), boxes, weight))
    assert best < 0.01
    shifted = raw.copy()
    shifted[..., 1] += 0.05
    cold, alarmed = raw.copy(), raw.copy()
    cold[..., 0] = -12.0
    alarmed[0, 28, 28, 0] = 3.0
    for fault in (shifted, cold, alarmed):
        assert float(loss(jnp.asarray(fault), boxes, weight)) > best + 0.02
    # Heat on an ignored box has no loss; heat without a box has.
    ignored = jnp.where(weight > 0.0, -1.0, 0.0).astype(jnp.float32)
    assert float(loss(jnp.asarray(raw), boxes, ignored)) < 0.01
    assert float(loss(jnp.asarray(raw), boxes, 0.0 * weight)) > 5.0
