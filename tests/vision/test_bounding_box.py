"""Bounding boxes: size, centre, projection and clipping."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision import bounding_box, box_projection, pinhole

EDGES = jnp.array([10.0, 20.0, 18.0, 70.0])


def test_box_center_and_geometric_mean_size() -> None:
    np.testing.assert_array_equal(bounding_box.box_center(EDGES), [14.0, 45.0])
    np.testing.assert_allclose(bounding_box.box_size(EDGES), 20.0, rtol=1e-15)


def test_inverted_box_has_positive_size() -> None:
    size = bounding_box.box_size(jnp.array([10.0, 20.0, 9.0, 30.0]))
    np.testing.assert_allclose(size, 1.0, rtol=1e-15)


def test_projected_box_spans_extreme_pixels_of_hull() -> None:
    intrinsics = pinhole.pinhole_intrinsics(jnp.float64(np.pi / 2), 128, 128)
    hull = jnp.array([[1.0, -2.0, 8.0], [-3.0, 0.0, 8.0], [0.0, 4.0, 16.0]])
    np.testing.assert_allclose(box_projection.projected_box(intrinsics, hull), [40.0, 48.0, 72.0, 80.0], rtol=1e-14)


@pytest.mark.parametrize(
    ("edges", "clipped", "truncated"),
    [
        ([10.0, 20.0, 18.0, 70.0], [10.0, 20.0, 18.0, 70.0], False),
        ([-5.0, 20.0, 18.0, 70.0], [0.0, 20.0, 18.0, 70.0], True),
        ([10.0, 20.0, 130.0, 99.0], [10.0, 20.0, 128.0, 96.0], True),
    ],
    ids=["inside", "over the left edge", "over the lower right corner"],
)
def test_box_is_clipped_to_frame_and_flagged(edges: list[float], clipped: list[float], truncated: bool) -> None:
    found, flag = bounding_box.clip_to_frame(jnp.array(edges), 128, 96)
    np.testing.assert_array_equal(found, clipped)
    assert bool(flag) is truncated
