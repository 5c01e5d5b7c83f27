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


image_loss = jax.jit(refinement_loss._image_loss)
place_loss = jax.jit(refinement_loss._place_loss)
candidate_boxes = jax.jit(jax.vmap(refinement_loss._candidate_boxes, in_axes=(None, None, 0)))
random_keys = jax.jit(jax.vmap(jax.random.key))


def label_arrays(box: np.ndarray, weight: float = 1.0, known: float = 1.0) -> refinement_loss._Labels:
    """Labels of an image with one box."""
    boxes, weights = np.zeros((8, 4), np.float32), np.zeros(8, np.float32)
    boxes[0], weights[0] = box, weight
    return refinement_loss._Labels(
        boxes=jnp.asarray(boxes), weight=jnp.asarray(weights), known=jnp.asarray(np.full((8, 4), known, np.float32))
    )


def losses(
    candidate: np.ndarray, refined: np.ndarray, logit: float, weight: float = 1.0, known: float = 1.0
) -> tuple[float, float]:
    """Losses of edges and quality for a candidate, the refined box and its logit; the true box is (20..60)."""
    places = jnp.asarray(places_of(refined), jnp.float32)
    crop_px = jnp.asarray(CROP_PX, jnp.float32)
    found = refinement_loss._Found(
        boxes=jax.jit(mean_boxes)(places, crop_px), places=places, quality=jnp.asarray([logit], jnp.float32)
    )
    labels = label_arrays(np.array([20.0, 20.0, 60.0, 60.0]), weight, known)
    edge, quality, _ = image_loss(found, crop_px, jnp.asarray(candidate[None], jnp.float32), labels)
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
    heat = np.full((32, 32), -9.0, np.float32)
    heat[10, 10] = 4.0
    maps = ProposalMaps(
        heatmap=jnp.asarray(heat),
        edges=jnp.asarray(np.tile([30.0, 34.0, 54.0, 50.0], (32, 32, 1)), jnp.float32),
    )
    true = np.array([60.0, 70.0, 100.0, 96.0])
    candidates = np.asarray(candidate_boxes(maps, label_arrays(true), random_keys(np.arange(300))))
    np.testing.assert_allclose(candidates[:, 0].mean(axis=0), [30, 34, 54, 50], atol=0.5)
    # The only true box comes twice, and some of its candidates hold half of it.
    for place in (-2, -1):
        np.testing.assert_allclose(candidates[:, place].mean(axis=0), true, atol=3.0)
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
    none = label_arrays(np.zeros(4), weight=0.0, known=0.0)
    candidates = np.asarray(candidate_boxes(maps, none, random_keys(np.arange(300)))).mean(axis=0)
    found = 0.5 * (candidates[:, :2] + candidates[:, 2:])
    np.testing.assert_allclose(found, 4.0 * (cells[:, ::-1] + 0.5), atol=0.5)


def test_loss_of_places_is_least_at_the_true_edge() -> None:
    fraction = np.full((1, 4), 0.3, np.float32)
    values = [
        np.sum(place_loss(places_of(np.full(4, 80.0 * at)).astype(np.float32), fraction)) for at in (0.25, 0.3, 0.35)
    ]
    assert values[1] < min(values[0], values[2]) - 1.0
