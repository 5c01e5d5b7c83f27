"""Depth of a ray-traced face at a known distance."""

import numpy as np
import pytest

from rpojax.training.synthetic_data import ray_traced_views
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.random_views import ViewSampling
from rpojax.vision.pinhole import pixel_directions


def test_depth_of_face_seen_head_on(box: TargetMesh) -> None:
    sampling = ViewSampling(1, size_px=33, samples=16)
    tracer = ray_traced_views.RayTracer(box, sampling)
    rotation = np.stack([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    frame = tracer.trace(rotation, np.array([4.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), 0)
    directions = pixel_directions(33, sampling.field_of_view_deg)
    # The face is in the plane x = 0.5.
    for row, column in ((16, 16), (14, 19)):
        assert frame[row, column, 3] == 1.0
        assert frame[row, column, 4] == pytest.approx(3.5 / directions[row, column, 2], abs=1e-3)
