"""Ray-traced views: geometry as the project's conventions have it, light, and blocks that outlive an interrupt."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from rpojax.training.radiance_field.image_quality import silhouette_box
from rpojax.training.synthetic_data import ray_traced_views, ray_tracing, view_cache, view_sampling
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.ray_traced_views import Views
from rpojax.training.synthetic_data.view_sampling import ViewSampling
from rpojax.vision.pinhole import pixel_directions


def test_silhouettes_are_where_the_pinhole_puts_the_vertices(box: TargetMesh, views: Views) -> None:
    size = views.alpha.shape[1]
    focal = 0.5 * size / np.tan(np.radians(0.5 * views.field_of_view_deg))
    for index in range(len(views)):
        seen = (box.vertices - views.position[index]) @ views.rotation[index].T
        pixels = 0.5 * size + focal * seen[:, :2] / seen[:, 2:]
        expected = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
        # A pixel that is covered in part says where its edge is to some tenths of a pixel, at 8 samples.
        np.testing.assert_allclose(silhouette_box(views.alpha[index]), expected, atol=0.8)


def test_depth_is_the_distance_to_the_surface(box: TargetMesh, views: Views) -> None:
    full = views.alpha > 0.999
    distance = np.linalg.norm(views.position, axis=1)
    for index in range(len(views)):
        depth = views.depth[index][full[index]]
        assert depth.min() > distance[index] - 0.62  # half the diagonal of the box
        assert depth.max() < distance[index] + 0.62


def test_the_middle_of_a_face_seen_head_on_is_as_far_as_it_is(box: TargetMesh) -> None:
    shell = ViewSampling(1, size_px=33, samples=16)
    tracer = ray_tracing.RayTracer(box, shell)
    rotation = np.stack([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    frame = tracer.trace(rotation, np.array([4.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), 0)
    tangents = pixel_directions(33, shell.field_of_view_deg)
    # The face lies in the plane x = 0.5, so that every pixel's distance is known.
    for row, column in ((16, 16), (14, 19)):
        assert frame[row, column, 3] == 1.0
        assert frame[row, column, 4] == pytest.approx(3.5 / tangents[row, column, 2], abs=1e-3)


def test_no_view_is_darker_than_its_phase_angle_allows(views: Views) -> None:
    away = views.position / np.linalg.norm(views.position, axis=1, keepdims=True)
    phase = np.degrees(np.arccos(np.sum(away * views.sun, axis=1)))
    assert phase.max() <= view_sampling.PHASE_LIMIT_DEG
    brightness = np.array([rgb[alpha > 0.999].mean() for rgb, alpha in zip(views.rgb, views.alpha, strict=True)])
    assert brightness[phase < 45.0].mean() > 2.0 * brightness[phase > 80.0].mean()
    assert (views.rgb[views.alpha == 0.0] == 0.0).all()


def test_earth_shine_lights_what_the_sun_does_not(box: TargetMesh, views: Views) -> None:
    lit = ray_traced_views.ray_trace_views(box, ViewSampling(4, size_px=32, samples=8, seed=5, earth_shine=0.1))
    assert (lit.rgb[lit.alpha > 0.999].mean(axis=1) > 0.0).all()
    np.testing.assert_array_equal(lit.position, views.position[:4])


def test_an_interrupted_call_goes_on_with_the_same_views(box: TargetMesh, tmp_path: Path) -> None:
    shell = ViewSampling(36, size_px=16, samples=2)

    def stop(done: int, total: int) -> None:
        if done == 34:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ray_traced_views.ray_trace_views(box, shell, tmp_path, stop)
    assert [path.name for path in tmp_path.iterdir()] == ["views_00000.npz"]
    first = (tmp_path / "views_00000.npz").stat().st_mtime_ns
    resumed = ray_traced_views.ray_trace_views(box, shell, tmp_path)
    assert (tmp_path / "views_00000.npz").stat().st_mtime_ns == first
    # To the last bit, or a training would not know these views again.
    np.testing.assert_array_equal(resumed.rgb, ray_traced_views.ray_trace_views(box, shell).rgb)


def test_the_first_views_can_be_seen_before_the_rest_are_traced(box: TargetMesh) -> None:
    shell, seen = ViewSampling(36, size_px=16, samples=2), []
    late = []
    views = ray_traced_views.ray_trace_views(
        box,
        shell,
        None,
        lambda done, total: late.append((done, len(seen))),
        lambda rgb, alpha: seen.append((rgb, alpha)),
    )
    [(rgb, alpha)] = seen
    np.testing.assert_array_equal(rgb, views.rgb[:32])
    np.testing.assert_array_equal(alpha, views.alpha[:32])
    assert (33, 1) in late


def test_kept_views_of_another_shell_are_not_taken_for_these(box: TargetMesh, tmp_path: Path) -> None:
    ray_traced_views.ray_trace_views(box, ViewSampling(2, size_px=16, samples=2, seed=1), tmp_path)
    other = ray_traced_views.ray_trace_views(box, ViewSampling(2, size_px=16, samples=2, seed=2), tmp_path)
    np.testing.assert_allclose(other.position, view_sampling.sample_views(box, ViewSampling(2, seed=2))[1])


def test_views_of_the_same_mesh_with_another_unwrapping_are_traced_anew(box: TargetMesh, tmp_path: Path) -> None:
    part = box.parts[0]
    rng = np.random.default_rng(0)
    keys = []
    for _ in range(2):
        unwrapped = dataclasses.replace(part, uv=rng.random((len(part.vertices), 2)))
        keys.append(view_cache.ViewCache(tmp_path, TargetMesh("box", (unwrapped,)), ViewSampling(2)).key)
    assert keys[0] != keys[1]


@pytest.mark.parametrize("place", [0.2, 0.5, 0.8])
def test_a_block_with_a_wrong_byte_is_traced_anew(box: TargetMesh, tmp_path: Path, place: float) -> None:
    shell = ViewSampling(2, size_px=16, samples=2)
    first = ray_traced_views.ray_trace_views(box, shell, tmp_path)
    (block,) = tmp_path.glob("views_*.npz")
    content = bytearray(block.read_bytes())
    for index in range(int(place * len(content)), int(place * len(content)) + 8):
        content[index] ^= 0xFF
    block.write_bytes(bytes(content))
    np.testing.assert_array_equal(ray_traced_views.ray_trace_views(box, shell, tmp_path).alpha, first.alpha)


def test_a_damaged_block_is_traced_anew(box: TargetMesh, tmp_path: Path) -> None:
    (tmp_path / "views_00000.npz").write_bytes(b"PK\x03\x04 not a block")
    assert len(ray_traced_views.ray_trace_views(box, ViewSampling(2, size_px=16, samples=2), tmp_path)) == 2
