"""Boxes: their size, centre, outline and cut."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision import bounding_box, pinhole

EDGES = jnp.array([10.0, 20.0, 18.0, 70.0])


def test_the_centre_and_size_of_a_box_are_its_middle_and_its_geometric_mean_side() -> None:
    np.testing.assert_array_equal(bounding_box.box_center(EDGES), [14.0, 45.0])
    np.testing.assert_allclose(bounding_box.box_size(EDGES), 20.0, rtol=1e-15)


def test_a_box_that_noise_has_turned_inside_out_still_has_a_positive_size() -> None:
    size = bounding_box.box_size(jnp.array([10.0, 20.0, 9.0, 30.0]))
    np.testing.assert_allclose(size, 1.0, rtol=1e-15)


def test_the_outline_spans_the_extreme_pixels_of_the_hull() -> None:
    lens = pinhole.pinhole_intrinsics(jnp.float64(np.pi / 2), 128, 128)
    hull = jnp.array([[1.0, -2.0, 8.0], [-3.0, 0.0, 8.0], [0.0, 4.0, 16.0]])
    np.testing.assert_allclose(bounding_box.projected_box(lens, hull), [40.0, 48.0, 72.0, 80.0], rtol=1e-14)


@pytest.mark.parametrize(
    ("edges", "cut", "truncated"),
    [
        ([10.0, 20.0, 18.0, 70.0], [10.0, 20.0, 18.0, 70.0], False),
        ([-5.0, 20.0, 18.0, 70.0], [0.0, 20.0, 18.0, 70.0], True),
        ([10.0, 20.0, 130.0, 99.0], [10.0, 20.0, 128.0, 96.0], True),
    ],
    ids=["inside", "over the left edge", "over the lower right corner"],
)
def test_a_box_is_cut_to_the_frame_and_says_so(edges: list[float], cut: list[float], truncated: bool) -> None:
    found, flag = bounding_box.clip_to_frame(jnp.array(edges), 128, 96)
    np.testing.assert_array_equal(found, cut)
    assert bool(flag) is truncated
