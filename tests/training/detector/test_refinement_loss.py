"""Loss of the refinement network and its candidate boxes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.training.detector import refinement_loss
from rpojax.vision.detector.box_decoding import ProposalMaps
from rpojax.vision.detector.edge_distribution import PLACES, mean_boxes

CROP_PX = np.array([[0.0, 0.0, 80.0, 80.0]])


def places_of(box: np.ndarray) -> np.ndarray:
    """Logits (1, 4, 48) of distributions on the two places next to each edge of a box, with the edges as means."""
    place = box / 80.0 * PLACES - 0.5
    share = np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(PLACES)))
    return np.log(np.maximum(share, 1e-12))[None]


def losses(
    candidate: np.ndarray, refined: np.ndarray, logit: float, weight: float = 1.0, known: float = 1.0
) -> tuple[float, float]:
    """Losses of edges and quality for a candidate, the refined box and its logit; the true box is (20..60)."""
    places = jnp.asarray(places_of(refined), jnp.float32)
    crop_px = jnp.asarray(CROP_PX, jnp.float32)
    found = refinement_loss._Found(
        boxes=mean_boxes(places, crop_px), places=places, quality=jnp.asarray([logit], jnp.float32)
    )
    labels = refinement_loss._Labels(
        boxes=jnp.zeros((8, 4), jnp.float32).at[0].set(jnp.array([20.0, 20.0, 60.0, 60.0], jnp.float32)),
        weight=jnp.zeros(8, jnp.float32).at[0].set(weight),
        known=jnp.full((8, 4), known, jnp.float32),
    )
    edge, quality, _ = refinement_loss._image_loss(found, crop_px, jnp.asarray(candidate[None], jnp.float32), labels)
    return float(edge[0]), float(quality[0])


def test_refinement_loss_penalises_wrong_edges_and_confidence() -> None:
    truth, near, far = (np.array(b, float) for b in ((20, 20, 60, 60), (24, 18, 64, 58), (70, 70, 80, 80)))
    # The best distribution is that of the two places around an edge, whose entropy remains.
    least = losses(near, truth, 9.0)
    assert least[0] < 0.5 * 4 * np.log(2.0) + 1e-3
    assert least[1] == pytest.approx(0.0, abs=1e-3)
    assert losses(near, near, 9.0)[0] > least[0] + 1.0
    assert losses(near, near, 9.0, known=0.0)[0] == pytest.approx(0.0, abs=1e-4)
    assert losses(near, truth, -3.0)[1] > 2.0
    # A negative candidate has a loss of quality only, an ignored one has none.
    assert losses(far, truth, -9.0) == (0.0, pytest.approx(0.0, abs=1e-3))
    assert losses(far, truth, 3.0)[1] > 2.0
    assert losses(near, near, 3.0, weight=-1.0) == (0.0, 0.0)


def test_candidates_are_proposals_and_true_boxes() -> None:
    maps = ProposalMaps(
        heatmap=jnp.full((32, 32), -9.0, jnp.float32).at[10, 10].set(4.0),
        edges=jnp.broadcast_to(jnp.array([30.0, 34.0, 54.0, 50.0], jnp.float32), (32, 32, 4)),
    )
    true = jnp.zeros((8, 4), jnp.float32).at[0].set(jnp.array([60.0, 70.0, 100.0, 96.0], jnp.float32))
    labels = refinement_loss._Labels(
        boxes=true,
        weight=jnp.zeros(8, jnp.float32).at[0].set(1.0),
        known=jnp.ones((8, 4), jnp.float32),
    )
    keys = jax.vmap(jax.random.key)(jnp.arange(300))
    find = jax.jit(jax.vmap(refinement_loss._candidate_boxes, in_axes=(None, None, 0)))
    candidates = np.asarray(find(maps, labels, keys))
    np.testing.assert_allclose(candidates[:, 0].mean(axis=0), [30, 34, 54, 50], atol=0.5)
    # The only true box comes twice, and some of its candidates hold half of it.
    for place in (-2, -1):
        np.testing.assert_allclose(candidates[:, place].mean(axis=0), true[0], atol=3.0)
    width = candidates[:, -2, 2] - candidates[:, -2, 0]
    assert (width < 25.0).any()
    assert (candidates[..., 2:] >= candidates[..., :2]).all()


def test_an_empty_image_gives_its_further_proposals() -> None:
    cells = np.array([[2, 3], [9, 20], [18, 5], [27, 27]])
    heat = np.full((32, 32), -9.0, np.float32)
    heat[cells[:, 0], cells[:, 1]] = [4.0, 3.0, 2.0, 1.0]
    center = 4.0 * (np.stack(np.meshgrid(np.arange(32), np.arange(32)), axis=-1) + 0.5)
    edges = np.concatenate([center - 6.0, center + 6.0], axis=-1).astype(np.float32)
    maps = ProposalMaps(heatmap=jnp.asarray(heat), edges=jnp.asarray(edges))
    none = refinement_loss._Labels(
        boxes=jnp.zeros((8, 4), jnp.float32), weight=jnp.zeros(8, jnp.float32), known=jnp.zeros((8, 4), jnp.float32)
    )
    keys = jax.vmap(jax.random.key)(jnp.arange(300))
    find = jax.jit(jax.vmap(refinement_loss._candidate_boxes, in_axes=(None, None, 0)))
    candidates = np.asarray(find(maps, none, keys)).mean(axis=0)
    found = 0.5 * (candidates[:, :2] + candidates[:, 2:])
    np.testing.assert_allclose(found, 4.0 * (cells[:, ::-1] + 0.5), atol=0.5)


def test_loss_of_places_is_least_at_the_true_edge() -> None:
    fraction = jnp.full((1, 4), 0.3, jnp.float32)
    values = [
        float(
            jnp.sum(refinement_loss._place_loss(jnp.asarray(places_of(np.full(4, 80.0 * at)), jnp.float32), fraction))
        )
        for at in (0.25, 0.3, 0.35)
    ]
    assert values[1] < min(values[0], values[2]) - 1.0
