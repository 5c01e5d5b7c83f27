"""Ray-traced views: geometry, light, and interruption."""

from pathlib import Path

import numpy as np
import pytest

from rpojax.training.radiance_field.evaluate_field import silhouette_box
from rpojax.training.synthetic_data import ray_traced_views
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.random_views import ViewSampling
from rpojax.training.synthetic_data.ray_traced_views import Views


def test_silhouettes_match_pinhole_projection_of_vertices(box: TargetMesh, views: Views) -> None:
    size = views.alpha.shape[1]
    focal = 0.5 * size / np.tan(np.radians(0.5 * views.field_of_view_deg))
    for index in range(len(views)):
        vertices_K = (box.vertices - views.position[index]) @ views.rotation[index].T
        pixels = 0.5 * size + focal * vertices_K[:, :2] / vertices_K[:, 2:]
        expected = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
        # With 8 samples alpha locates an edge to some tenths of a pixel.
        np.testing.assert_allclose(silhouette_box(views.alpha[index]), expected, atol=0.8)


def test_depth_is_distance_to_surface(box: TargetMesh, views: Views) -> None:
    full = views.alpha > 0.999
    distance = np.linalg.norm(views.position, axis=1)
    for index in range(len(views)):
        depth = views.depth[index][full[index]]
        assert depth.min() > distance[index] - 0.62  # half the diagonal of the box
        assert depth.max() < distance[index] + 0.62


def test_light_from_all_sides_lights_every_side(box: TargetMesh, views: Views) -> None:
    sampling = ViewSampling(4, size_px=32, samples=8, seed=5, fill_half_angle_deg=180.0)
    lit = ray_traced_views.ray_trace_views(box, sampling)
    assert (lit.filled[lit.alpha > 0.999].mean(axis=1) > 0.0).all()
    np.testing.assert_array_equal(lit.position, views.position[:4])


def test_interrupted_call_continues_with_same_views(box: TargetMesh, tmp_path: Path) -> None:
    sampling = ViewSampling(36, size_px=16, samples=2)

    def stop(done: int, total: int) -> None:
        if done == 34:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ray_traced_views.ray_trace_views(box, sampling, tmp_path, stop)
    assert [path.name for path in tmp_path.iterdir()] == ["views_00000.npz"]
    first = (tmp_path / "views_00000.npz").stat().st_mtime_ns
    resumed = ray_traced_views.ray_trace_views(box, sampling, tmp_path)
    assert (tmp_path / "views_00000.npz").stat().st_mtime_ns == first
    # Bit-equal, since the views are part of the key of a checkpoint.
    np.testing.assert_array_equal(resumed.sunlit, ray_traced_views.ray_trace_views(box, sampling).sunlit)


def test_first_block_is_reported_before_the_others(box: TargetMesh) -> None:
    sampling, reported = ViewSampling(36, size_px=16, samples=2), []
    progress = []
    views = ray_traced_views.ray_trace_views(
        box,
        sampling,
        None,
        lambda done, total: progress.append((done, len(reported))),
        lambda rgb, alpha: reported.append((rgb, alpha)),
    )
    [(rgb, alpha)] = reported
    np.testing.assert_array_equal(rgb, views.sunlit[:32])
    np.testing.assert_array_equal(alpha, views.alpha[:32])
    assert (33, 1) in progress
