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
decode_peaks = jax.jit(box_decoding.decode_peaks, static_argnums=1)
soft_decode_boxes = jax.jit(box_decoding.soft_decode_boxes, static_argnums=2)


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
    peak = decode_peaks(maps, 1)[1]
    noise = np.random.default_rng(0).normal(size=(CELLS, CELLS, 4))
    point = np.asarray(maps.heatmap, np.float64), np.asarray(maps.edges, np.float64) + noise

    @jax.jit
    @partial(jax.value_and_grad, argnums=(0, 1))
    def readout(heat: jax.Array, edges: jax.Array) -> jax.Array:
        (box,), (score,) = box_decoding.soft_decode_boxes(ProposalMaps(heatmap=heat, edges=edges), peak, 0.5)
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


def noisy_maps() -> ProposalMaps:
    """Maps of two spacecraft with edges and heats that scatter, as those of a network do."""
    maps, rng = maps_of([(20.5, 30.0, 41.0, 44.5), (80.0, 70.0, 125.0, 110.0)], [2.0, 3.0]), np.random.default_rng(3)
    heat = np.asarray(maps.heatmap) + 0.3 * rng.normal(size=(CELLS, CELLS)).astype(np.float32)
    edges = np.asarray(maps.edges) + rng.normal(size=(CELLS, CELLS, 4)).astype(np.float32)
    return ProposalMaps(heatmap=jnp.asarray(heat), edges=jnp.asarray(edges))


def test_soft_boxes_of_a_low_temperature_are_the_hard_ones() -> None:
    maps = noisy_maps()
    found, peaks = decode_peaks(maps, 2)
    boxes, scores = soft_decode_boxes(maps, peaks, 1e-3)
    np.testing.assert_allclose(boxes, found.box_px, atol=1e-4)
    np.testing.assert_allclose(scores, found.score, rtol=1e-5)
    warm, lower = soft_decode_boxes(maps, peaks, 1.0)
    assert np.abs(warm - found.box_px).max() > 0.05
    assert (np.asarray(lower) < np.asarray(found.score)).all()


def test_soft_box_at_the_border_has_no_part_of_cells_beyond() -> None:
    maps = maps_of([(0.0, 0.0, 6.0, 5.0)], [3.0])
    _, peaks = decode_peaks(maps, 1)
    assert int(peaks[0]) == 0
    boxes, _ = soft_decode_boxes(maps, peaks, 100.0)
    # At such a temperature all nine cells in the window inside of the maps weigh alike, and none of those outside.
    heat, edges = np.asarray(maps.heatmap), np.asarray(maps.edges)
    expected = []
    for row in range(3):
        for column in range(3):
            near = np.s_[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
            weight = np.exp(heat[near])
            expected.append((weight[..., None] * edges[near]).sum(axis=(0, 1)) / weight.sum())
    np.testing.assert_allclose(boxes[0], np.clip(np.mean(expected, axis=0), 0.0, 128.0), atol=0.1)
