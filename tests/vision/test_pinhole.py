"""The pinhole's pixels against worked cases."""

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.vision import pinhole

lens = jax.jit(pinhole.pinhole_intrinsics, static_argnums=(1, 2))
project = jax.jit(pinhole.project)
RIGHT_ANGLE = jnp.float64(np.pi / 2)


def test_a_right_angled_lens_has_half_the_width_as_focal_length_and_looks_through_the_middle() -> None:
    found = lens(RIGHT_ANGLE, 640, 480)
    np.testing.assert_allclose(found.focal_px, 320.0, rtol=1e-15)
    np.testing.assert_array_equal(found.center_px, [320.0, 240.0])


def test_the_field_of_view_spans_the_width_of_the_frame() -> None:
    found = lens(jnp.float64(np.deg2rad(10.0)), 128, 128)
    edge = np.array([[np.tan(np.deg2rad(5.0)), 0.0, 1.0], [-np.tan(np.deg2rad(5.0)), 0.0, 1.0]])
    np.testing.assert_allclose(project(found, edge)[0], [128.0, 0.0], atol=1e-12)


def test_points_to_the_right_and_below_have_larger_pixels_and_far_points_are_nearer_to_the_middle() -> None:
    pixels = project(lens(RIGHT_ANGLE, 640, 480), np.array([[1.0, 2.0, 4.0], [1.0, 2.0, 8.0], [0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(pixels, [[400.0, 360.0, 320.0], [400.0, 320.0, 240.0]], rtol=1e-14)
