"""Derivatives of the projected bounding box in both modes against finite differences."""

import jax
import numpy as np
from gradient_checks import check, check_finite

from rpojax.vision import box_projection, pinhole


@jax.jit
def outline(x: jax.Array, hull_K: jax.Array) -> jax.Array:
    lens = pinhole.pinhole_intrinsics(0.2 + 0.01 * x[12], 128, 128)
    return 1e-2 * box_projection.projected_box(lens, hull_K + x[:12].reshape(4, 3))


def test_derivatives_of_the_projected_box_are_right() -> None:
    check(outline, 13, np.array([[1.0, 0.2, 30.0], [-1.1, -0.3, 29.0], [0.1, 0.9, 31.0], [0.2, -1.2, 30.5]]))


def test_the_projected_box_has_finite_derivatives_with_points_behind_the_camera_and_at_its_centre() -> None:
    check_finite(outline, 13, np.array([[1.0, 0.2, -30.0], [0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.2, -1.2, 30.5]]))
