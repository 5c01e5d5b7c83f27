"""Loss of the refinement network and its candidate boxes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.training.detector import refinement_loss


def losses(
    candidate: np.ndarray, refined: np.ndarray, logit: float, weight: float = 1.0, known: float = 1.0
) -> tuple[float, float]:
    """Losses of edges and quality for a candidate, the refined box and its logit; the true box is (20..60)."""
    crop_px = np.array([[0.0, 0.0, 80.0, 80.0]])
    base = np.array([0.2, 0.2, 0.8, 0.8])
    raw = np.concatenate([(refined / 80.0 - base) / 0.25, [logit]])[None]
    truth, weights = np.zeros((8, 4)), np.zeros(8)
    truth[0], weights[0] = (20.0, 20.0, 60.0, 60.0), weight
    flags = np.full((8, 4), known)
    arrays = (jnp.asarray(values, jnp.float32) for values in (raw, crop_px, candidate[None], truth, weights, flags))
    edge, quality, _ = refinement_loss._image_loss(*arrays)
    return float(edge[0]), float(quality[0])


def test_refinement_loss_penalises_wrong_edges_and_confidence() -> None:
    truth, near, far = (np.array(b, float) for b in ((20, 20, 60, 60), (24, 18, 64, 58), (70, 70, 80, 80)))
    assert losses(near, truth, 9.0) == (pytest.approx(0.0, abs=1e-4), pytest.approx(0.0, abs=1e-3))
    assert losses(near, near, 9.0)[0] > 0.2
    assert losses(near, near, 9.0, known=0.0)[0] == pytest.approx(0.0, abs=1e-4)
    assert losses(near, truth, -3.0)[1] > 2.0
    # A negative candidate has a loss of quality only, an ignored one has none.
    assert losses(far, truth, -9.0) == (0.0, pytest.approx(0.0, abs=1e-3))
    assert losses(far, truth, 3.0)[1] > 2.0
    assert losses(near, near, 3.0, weight=-1.0) == (0.0, 0.0)


def test_candidates_are_proposals_true_and_random_boxes() -> None:
    heat = jnp.full((32, 32), -9.0, jnp.float32).at[10, 10].set(4.0)
    edges = jnp.broadcast_to(jnp.array([30.0, 34.0, 54.0, 50.0], jnp.float32), (32, 32, 4))
    boxes = jnp.zeros((8, 4), jnp.float32).at[0].set(jnp.array([60.0, 70.0, 100.0, 96.0], jnp.float32))
    weight = jnp.zeros(8, jnp.float32).at[0].set(1.0)
    keys = jax.vmap(jax.random.key)(jnp.arange(200))
    candidates = np.asarray(
        jax.jit(jax.vmap(lambda key: refinement_loss._candidate_boxes(heat, edges, boxes, weight, key)))(keys)
    )
    np.testing.assert_allclose(candidates[:, 0].mean(axis=0), [30, 34, 54, 50], atol=0.5)
    np.testing.assert_allclose(candidates[:, -2].mean(axis=0), boxes[0], atol=1.5)
    assert candidates[:, -2].std() > candidates[:, 0].std()
    assert (candidates[..., 2:] >= candidates[..., :2]).all()
    assert candidates[:, -1, 0].std() > 20.0
