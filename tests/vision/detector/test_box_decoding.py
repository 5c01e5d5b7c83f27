"""Boxes from the maps of the proposal network, hard and soft."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.detector import box_decoding
from rpojax.vision.detector.box_decoding import STRIDE, ProposalMaps

CELLS = 32

decode_boxes = jax.jit(box_decoding.decode_boxes, static_argnums=1)
soft_decode_box = jax.jit(box_decoding.soft_decode_box)


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
    heat, edges = np.array(maps.heatmap), np.array(maps.edges)
    heat[12, 22] = 1.5  # a second peak, three cells away
    edges[11:14, 21:24] = [41.0, 41.0, 101.0, 61.0]
    found = decode_boxes(ProposalMaps(heatmap=jnp.asarray(heat), edges=jnp.asarray(edges)), 3)
    np.testing.assert_allclose(found.box_px[0], box, atol=1.5)
    np.testing.assert_array_less(found.score[1:], 0.01)


def test_box_beyond_frame_is_clipped() -> None:
    found = decode_boxes(maps_of([(-6.0, 50.0, 20.0, 140.0)], [3.0]), 1)
    np.testing.assert_allclose(found.box_px[0], [0.0, 50.0, 20.0, 128.0], atol=1e-3)


def test_soft_box_gradient_in_maps_matches_finite_differences() -> None:
    maps = maps_of([(20.5, 30.0, 41.0, 44.5)], [2.0])
    noise = np.random.default_rng(0).normal(size=(CELLS, CELLS, 4))
    point = np.asarray(maps.heatmap, np.float64), np.asarray(maps.edges, np.float64) + noise

    @jax.jit
    @partial(jax.value_and_grad, argnums=(0, 1))
    def readout(heat: jax.Array, edges: jax.Array) -> jax.Array:
        box, score = box_decoding.soft_decode_box(ProposalMaps(heatmap=heat, edges=edges))
        return jnp.sum(box * jnp.array([1.0, -0.5, 0.3, 0.8])) + 20.0 * score

    gradients = readout(*point)[1]
    rng = np.random.default_rng(1)
    # The direction moves all cells; the step is small against the distance to the next peak.
    for part, values in enumerate(point):
        direction = rng.normal(size=values.shape)
        ahead, back = (
            float(readout(*(v + sign * 1e-5 * direction if i == part else v for i, v in enumerate(point)))[0])
            for sign in (1.0, -1.0)
        )
        slope = float(np.sum(np.asarray(gradients[part]) * direction))
        assert slope == pytest.approx((ahead - back) / 2e-5, rel=1e-5)
        assert abs(slope) > 1e-3


def test_soft_box_equals_hard_box_for_clear_peak() -> None:
    box = (20.0, 30.0, 60.0, 44.0)
    found, score = soft_decode_box(maps_of([box], [4.0]))
    np.testing.assert_allclose(found, box, atol=1e-3)
    assert 0.8 < score < 1.0
