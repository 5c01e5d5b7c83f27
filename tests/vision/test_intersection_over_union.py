"""Intersection over union against counted pixels, its generalisation against the paper's definition."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision import intersection_over_union as overlap

SIDE_PX = 12


def random_boxes(seed: int, count: int) -> np.ndarray:
    """Boxes (n, 4) with edges at whole pixels; some are empty."""
    corners = np.random.default_rng(seed).integers(0, SIDE_PX + 1, (count, 2, 2))
    return np.sort(corners, axis=1).reshape(count, 4).astype(np.float64)


def mask(box: np.ndarray) -> np.ndarray:
    """Pixels inside a box."""
    left, top, right, bottom = box.astype(int)
    found = np.zeros((SIDE_PX, SIDE_PX), bool)
    found[top:bottom, left:right] = True
    return found


@pytest.mark.parametrize("to_array", [np.asarray, jnp.asarray], ids=["numpy", "jax"])
def test_areas_and_iou_equal_counted_pixels(to_array: Callable[[np.ndarray], Any]) -> None:
    a, b = random_boxes(1, 30), random_boxes(2, 40)
    shared = np.array([[(mask(one) & mask(other)).sum() for other in b] for one in a])
    either = np.array([[(mask(one) | mask(other)).sum() for other in b] for one in a])
    boxes = to_array(a), to_array(b)
    found = overlap.pairwise_iou(*boxes)
    assert isinstance(found, type(boxes[0]))
    np.testing.assert_allclose(found, shared / np.maximum(either, 1), rtol=1e-15)
    np.testing.assert_array_equal(overlap.intersection_area(boxes[0][:, None, :], boxes[1][None, :, :]), shared)
    np.testing.assert_array_equal(overlap.box_area(boxes[0]), [mask(one).sum() for one in a])
    np.testing.assert_array_equal(overlap.intersection_over_union(boxes[0], boxes[1][:30]), np.diagonal(found))


def test_inverted_boxes_are_empty() -> None:
    inverted, whole = np.array([[8.0, 8.0, 2.0, 2.0]]), np.array([[0.0, 0.0, 10.0, 10.0]])
    assert overlap.box_area(inverted) == overlap.intersection_over_union(inverted, whole) == 0.0
    assert overlap.intersection_over_union(inverted, inverted) == 0.0


def test_generalised_iou_is_iou_less_the_part_of_the_hull_outside_of_both() -> None:
    a = jnp.array([[0.0, 0.0, 2.0, 2.0], [0.0, 0.0, 2.0, 2.0], [0.0, 0.0, 1.0, 1.0]])
    b = jnp.array([[0.0, 0.0, 2.0, 2.0], [1.0, 1.0, 3.0, 3.0], [3.0, 0.0, 4.0, 2.0]])
    # Equal; 1 of 7 with 2 of the hull's 9 outside; disjoint, 3 of the hull's 8 inside.
    np.testing.assert_allclose(overlap.generalized_iou(a, b), [1.0, 1 / 7 - 2 / 9, -5 / 8], rtol=1e-15)


def test_generalised_iou_of_disjoint_boxes_grows_towards_each_other() -> None:
    still = jnp.array([10.0, 0.0, 12.0, 2.0])
    slope = jax.grad(lambda box: overlap.generalized_iou(box, still))(jnp.array([0.0, 0.0, 2.0, 2.0]))
    # Union 8 / hull 24 - 1; an edge moved by 1 px changes the union by 2, and the hull too if it is the outer one.
    np.testing.assert_allclose(slope[0], -2 / 24 + 8 * 2 / 24**2, rtol=1e-14)
    np.testing.assert_allclose(slope[2], 2 / 24, rtol=1e-14)
