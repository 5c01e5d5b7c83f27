"""The square region against the cone of the bounding sphere."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.pinhole import pinhole_intrinsics
from rpojax.vision.radiance_field.field_file import load_field
from rpojax.vision.radiance_field.image_region import project_region
from rpojax.vision.radiance_field.target_field import RadianceField, bounding_sphere


@pytest.fixture(scope="module")
def field() -> RadianceField:
    """Field of the packaged target."""
    return load_field()[0]


@pytest.mark.parametrize("off_axis_deg", [0.0, 10.0, 25.0, 35.0])
def test_region_tightly_contains_bounding_sphere(field: RadianceField, off_axis_deg: float) -> None:
    center, radius = (np.asarray(value, np.float64) for value in bounding_sphere(field))
    intrinsics = pinhole_intrinsics(jnp.asarray(np.radians(60.0)), 256, 256)
    angle, half = np.radians(off_axis_deg), np.radians(20.0)
    direction_K = np.array([np.sin(angle), 0.0, np.cos(angle)])
    r_KT_T = center - radius / np.sin(half) * direction_K
    corner, side, visible = project_region(
        field, intrinsics, *(jnp.asarray(v, jnp.float32) for v in (r_KT_T, np.eye(3)))
    )
    low = (np.asarray(corner) - np.asarray(intrinsics.center_px)) / float(intrinsics.focal_px)
    high = low + float(side) / float(intrinsics.focal_px)
    assert bool(visible)
    # The rim of the sphere is a cone of 20 deg about the line to its centre.
    assert low[0] < np.tan(angle - half)
    assert np.tan(angle + half) < high[0]
    assert high[0] - low[0] < 1.1 * (np.tan(angle + half) - np.tan(angle - half))
