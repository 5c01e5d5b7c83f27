"""Boxes from the maps of the proposal network, hard and soft."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.detector.box_decoding import STRIDE, ProposalMaps, decode_boxes, soft_decode_box

CELLS = 32


def maps_of(boxes: list[tuple[float, float, float, float]], heats: list[float]) -> ProposalMaps:
    """Maps of a perfect network: heat falls off around each centre, edges are those of the nearest box."""
    place = (np.arange(CELLS) + 0.5) * STRIDE
    heat = np.full((CELLS, CELLS), -9.0)
    edges = np.zeros((CELLS, CELLS, 4))
    for box, top in zip(boxes, heats, strict=True):
        x, y = 0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])
        near = top - 0.1 * ((place[None, :] - x) ** 2 + (place[:, None] - y) ** 2)
        here = near > heat
        heat[here] = near[here]
        edges[here] = box
    return ProposalMaps(heatmap=jnp.asarray(heat, jnp.float32), edges=jnp.asarray(edges, jnp.float32))


def sigmoid(value: float) -> float:
    return 1.0 / (1.0 + np.exp(-value))


def test_two_spacecraft_give_two_boxes_by_falling_score() -> None:
    first, second = (20.5, 30.0, 41.0, 44.5), (80.0, 70.0, 120.0, 110.0)
    found = decode_boxes(maps_of([first, second], [2.0, 3.0]), 4)
    np.testing.assert_allclose(found.box_px[:2], [second, first], atol=1e-3)
    # A centre is up to half a cell away from the centre of its cell.
    scores = np.asarray(found.score, np.float64)
    assert sigmoid(3.0) + 1e-6 >= scores[0] > scores[1] > sigmoid(2.0 - 0.1 * 2 * 2.0**2) - 1e-6
    np.testing.assert_array_less(found.score[2:], 0.01)


def test_weaker_peak_on_same_spacecraft_is_suppressed() -> None:
    box = (40.0, 40.0, 100.0, 60.0)
    maps = maps_of([box, (42.0, 40.0, 100.0, 60.0)], [2.0, 1.0])
    heat = maps.heatmap.at[12, 22].set(1.5)  # a second peak, three cells away
    edges = maps.edges.at[11:14, 21:24].set(jnp.array([41.0, 41.0, 101.0, 61.0], jnp.float32))
    found = decode_boxes(ProposalMaps(heatmap=heat, edges=edges), 3)
    np.testing.assert_allclose(found.box_px[0], box, atol=1.5)
    np.testing.assert_array_less(found.score[1:], 0.01)


def test_box_beyond_frame_is_clipped() -> None:
    found = decode_boxes(maps_of([(-6.0, 50.0, 20.0, 140.0)], [3.0]), 1)
    np.testing.assert_allclose(found.box_px[0], [0.0, 50.0, 20.0, 128.0], atol=1e-3)


def test_soft_box_gradient_in_maps_matches_finite_differences() -> None:
    maps = maps_of([(20.5, 30.0, 41.0, 44.5)], [2.0])
    noise = np.random.default_rng(0).normal(size=(CELLS, CELLS, 4))
    maps = ProposalMaps(heatmap=maps.heatmap.astype(jnp.float64), edges=maps.edges.astype(jnp.float64) + noise)

    def readout(heat: jax.Array, edges: jax.Array) -> jax.Array:
        box, score = soft_decode_box(ProposalMaps(heatmap=heat, edges=edges))
        return jnp.sum(box * jnp.array([1.0, -0.5, 0.3, 0.8])) + 20.0 * score

    gradients = jax.grad(readout, argnums=(0, 1))(maps.heatmap, maps.edges)
    rng = np.random.default_rng(1)
    # The direction moves all cells; the step is small against the distance to the next peak.
    for part, values in enumerate((maps.heatmap, maps.edges)):
        direction = jnp.asarray(rng.normal(size=values.shape))
        pair = [(maps.heatmap, maps.edges) for _ in range(2)]
        ahead, back = (
            readout(*(v + sign * 1e-5 * direction if i == part else v for i, v in enumerate(p)))
            for p, sign in zip(pair, (1.0, -1.0), strict=True)
        )
        assert float(jnp.sum(gradients[part] * direction)) == pytest.approx(float((ahead - back) / 2e-5), rel=1e-5)
        assert abs(float(jnp.sum(gradients[part] * direction))) > 1e-3


def test_soft_box_equals_hard_box_for_clear_peak() -> None:
    box = (20.0, 30.0, 60.0, 44.0)
    found, score = soft_decode_box(maps_of([box], [4.0]))
    np.testing.assert_allclose(found, box, atol=1e-3)
    assert 0.8 < score < 1.0
