"""Depth and light of a ray-traced face at a known distance."""

import dataclasses

import numpy as np
import pytest

from rpojax.training.synthetic_data import ray_traced_views
from rpojax.training.synthetic_data.meshes.target_mesh import Material, TargetMesh
from rpojax.training.synthetic_data.random_views import ViewSampling
from rpojax.vision.pinhole import pixel_directions


def test_depth_of_face_seen_head_on(box: TargetMesh) -> None:
    sampling = ViewSampling(1, size_px=33, samples=16)
    tracer = ray_traced_views.RayTracer(box, sampling)
    rotation = np.stack([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    frame = tracer.trace(rotation, np.array([4.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), 0)
    directions = pixel_directions(33, sampling.field_of_view_deg)
    # The face is in the plane x = 0.5.
    for row, column in ((16, 16), (14, 19)):
        assert frame[row, column, 6] == 1.0
        assert frame[row, column, 7] == pytest.approx(3.5 / directions[row, column, 2], abs=1e-3)


@pytest.mark.parametrize("angle_deg", [0.0, 90.0, 180.0])
def test_fill_light_is_that_of_a_cone(box: TargetMesh, angle_deg: float) -> None:
    sampling = ViewSampling(1, size_px=9, samples=4096)
    matte = TargetMesh("matte", (dataclasses.replace(box.parts[0], material=Material((0.5, 0.5, 0.5), 0.0, 1.0)),))
    tracer = ray_traced_views.RayTracer(matte, sampling)
    angle = np.radians(angle_deg)
    face_on, fill = np.array([1.0, 0.0, 0.0]), np.array([np.cos(angle), np.sin(angle), 0.0])
    rotation = np.stack([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    frame = tracer.trace(rotation, np.array([4.0, 0.0, 0.0]), face_on, fill, 0)
    # Irradiance of a face by even light from a cone of half angle 68 deg, by that of a face across its axis.
    rng = np.random.default_rng(0)
    cosine = rng.uniform(np.cos(np.radians(68.0)), 1.0, 200_000)
    azimuth = rng.uniform(0.0, 2.0 * np.pi, len(cosine))
    sideways = np.sqrt(1.0 - cosine**2) * np.cos(azimuth)
    expected = np.mean(np.maximum(np.cos(angle) * cosine - np.sin(angle) * sideways, 0.0)) / np.mean(cosine)
    filled, sunlit = frame[4, 4, 3], frame[4, 4, 0]
    # The material's diffuse part depends on the angles somewhat (Burley's retro-reflection).
    assert filled / sunlit == pytest.approx(expected, abs=0.04)
