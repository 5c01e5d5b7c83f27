"""Files of finished views: keys and damaged files."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from rpojax.training.synthetic_data import random_views, ray_traced_views
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.random_views import ViewSampling
from rpojax.training.synthetic_data.view_cache import mesh_digest


def test_stored_views_of_other_sampling_are_not_used(box: TargetMesh, tmp_path: Path) -> None:
    ray_traced_views.ray_trace_views(box, ViewSampling(2, size_px=16, samples=2, seed=1), tmp_path)
    other = ray_traced_views.ray_trace_views(box, ViewSampling(2, size_px=16, samples=2, seed=2), tmp_path)
    np.testing.assert_allclose(other.position, random_views.sample_views(box, ViewSampling(2, seed=2)).position)


def test_the_digest_of_a_mesh_depends_on_texture_coordinates(box: TargetMesh) -> None:
    part = box.parts[0]
    rng = np.random.default_rng(0)
    digests = []
    for _ in range(2):
        unwrapped = dataclasses.replace(part, uv=rng.random((len(part.vertices), 2)))
        digests.append(mesh_digest(TargetMesh("box", (unwrapped,))))
    assert digests[0] != digests[1]


@pytest.mark.parametrize("place", [0.2, 0.5, 0.8])
def test_corrupted_block_is_traced_again(box: TargetMesh, tmp_path: Path, place: float) -> None:
    sampling = ViewSampling(2, size_px=16, samples=2)
    first = ray_traced_views.ray_trace_views(box, sampling, tmp_path)
    (block,) = tmp_path.glob("views_*.npz")
    content = bytearray(block.read_bytes())
    for index in range(int(place * len(content)), int(place * len(content)) + 8):
        content[index] ^= 0xFF
    block.write_bytes(bytes(content))
    np.testing.assert_array_equal(ray_traced_views.ray_trace_views(box, sampling, tmp_path).alpha, first.alpha)


def test_damaged_block_is_traced_again(box: TargetMesh, tmp_path: Path) -> None:
    (tmp_path / "views_00000.npz").write_bytes(b"PK\x03\x04 not a block")
    assert len(ray_traced_views.ray_trace_views(box, ViewSampling(2, size_px=16, samples=2), tmp_path)) == 2
