"""Pinhole projection against worked cases."""

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.vision import pinhole

pinhole_intrinsics = jax.jit(pinhole.pinhole_intrinsics, static_argnums=(1, 2))
project = jax.jit(pinhole.project)
RIGHT_ANGLE = jnp.float64(np.pi / 2)


def test_focal_length_of_right_angled_field_of_view_is_half_the_width() -> None:
    found = pinhole_intrinsics(RIGHT_ANGLE, 640, 480)
    np.testing.assert_allclose(found.focal_px, 320.0, rtol=1e-15)
    np.testing.assert_array_equal(found.center_px, [320.0, 240.0])


def test_field_of_view_spans_frame_width() -> None:
    found = pinhole_intrinsics(jnp.float64(np.deg2rad(10.0)), 128, 128)
    edge = np.array([[np.tan(np.deg2rad(5.0)), 0.0, 1.0], [-np.tan(np.deg2rad(5.0)), 0.0, 1.0]])
    np.testing.assert_allclose(project(found, edge)[0], [128.0, 0.0], atol=1e-12)


def test_projection_of_worked_points() -> None:
    pixels = project(
        pinhole_intrinsics(RIGHT_ANGLE, 640, 480), np.array([[1.0, 2.0, 4.0], [1.0, 2.0, 8.0], [0.0, 0.0, 1.0]])
    )
    np.testing.assert_allclose(pixels, [[400.0, 360.0, 320.0], [400.0, 320.0, 240.0]], rtol=1e-14)


def test_pixel_directions_project_to_pixel_centres() -> None:
    directions = pinhole.pixel_directions(4, 90.0).reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-6)
    pixels = project(pinhole_intrinsics(RIGHT_ANGLE, 4, 4), directions.astype(np.float64))
    rows, columns = np.divmod(np.arange(16), 4)
    np.testing.assert_allclose(pixels, [columns + 0.5, rows + 0.5], atol=1e-6)
