"""A box as a target, and ray-traced views of it."""

import numpy as np
import pytest

from rpojax.training.synthetic_data import ray_traced_views
from rpojax.training.synthetic_data.meshes.target_mesh import Material, MeshPart, TargetMesh
from rpojax.training.synthetic_data.random_views import ViewSampling
from rpojax.training.synthetic_data.ray_traced_views import Views

pytest.importorskip("mitsuba")
trimesh = pytest.importorskip("trimesh")


@pytest.fixture(scope="session")
def box() -> TargetMesh:
    """A grey box, 1 x 0.6 x 0.4 m."""
    mesh = trimesh.creation.box(extents=(1.0, 0.6, 0.4))
    part = MeshPart(np.asarray(mesh.vertices), np.asarray(mesh.faces), Material(color=(0.5, 0.4, 0.3)))
    return TargetMesh("box", (part,))


@pytest.fixture(scope="session")
def views(box: TargetMesh) -> Views:
    """Small views of the box."""
    return ray_traced_views.ray_trace_views(box, ViewSampling(24, size_px=32, samples=8, seed=5))
