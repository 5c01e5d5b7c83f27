"""Mesh files: units, materials, and errors for unusable files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from rpojax.core.constants import RADIUS_EARTH
from rpojax.training.synthetic_data.meshes import mesh_files, target_mesh
from rpojax.training.synthetic_data.meshes.mesh_files import MeshError


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".glb"])
def test_units_and_centring_of_mesh_file(tmp_path: Path, suffix: str) -> None:
    box = trimesh.creation.box(extents=(1000.0, 600.0, 400.0))
    box.apply_translation((5000.0, 0.0, 0.0))
    path = tmp_path / f"box{suffix}"
    box.export(path)
    mesh = mesh_files.load_mesh(path, units="mm", center=True)
    np.testing.assert_allclose(mesh.bounds, [[-0.5, -0.3, -0.2], [0.5, 0.3, 0.2]], atol=1e-6)
    with pytest.raises(MeshError, match="units"):
        mesh_files.load_mesh(path, center=True)
    with pytest.raises(MeshError, match="center=True"):
        mesh_files.load_mesh(path, units="mm")


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("empty.stl", "solid x\nendsolid x\n", "mesh"),
        ("empty.obj", "", "mesh"),
        ("broken.glb", "no glb at all", "cannot be read"),
        ("mesh.step", "", "expected one of .glb"),
    ],
)
def test_file_without_mesh_is_an_error_of_one_line(tmp_path: Path, name: str, content: str, expected: str) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(MeshError, match=expected) as error:
        mesh_files.load_mesh(path)
    assert name in str(error.value)


def written_and_read(tmp_path: Path, visual: object, suffix: str = ".glb") -> target_mesh.TargetMesh:
    """A box with a trimesh visual, written and read."""
    box = trimesh.creation.box(extents=(1.0, 0.6, 0.4))
    box.visual = visual
    path = tmp_path / f"box{suffix}"
    box.export(path)
    return mesh_files.load_mesh(path)


@pytest.mark.parametrize(
    ("given", "color", "metallic", "roughness"),
    [
        ({"baseColorFactor": [128, 128, 128, 255], "metallicFactor": 0.0, "roughnessFactor": 0.4}, 0.502, 0.0, 0.4),
        ({"baseColorFactor": [1, 1, 1, 255], "metallicFactor": 0.5, "roughnessFactor": 0.9}, 0.0039, 0.5, 0.9),
        ({}, 0.9, 1.0, 1.0),
    ],
)
def test_gltf_material_follows_format(
    tmp_path: Path, given: dict[str, Any], color: float, metallic: float, roughness: float
) -> None:
    material = trimesh.visual.material.PBRMaterial(**given)
    uv = np.zeros((8, 2))
    (part,) = written_and_read(tmp_path, trimesh.visual.TextureVisuals(uv=uv, material=material)).parts
    np.testing.assert_allclose(part.material.color, color, atol=1e-3)
    assert (part.material.metallic, part.material.roughness) == (pytest.approx(metallic), pytest.approx(roughness))


def test_obj_colours_are_srgb_and_textures_are_kept(tmp_path: Path) -> None:
    from PIL import Image

    visual = trimesh.visual.material.SimpleMaterial(diffuse=[128, 0, 255, 255])
    (part,) = written_and_read(
        tmp_path, trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=visual), ".obj"
    ).parts
    np.testing.assert_allclose(part.material.color, [(128 / 255) ** 2.2, 0.0002, 0.9], atol=2e-3)
    pixels = np.full((4, 4, 3), 200, np.uint8)
    textured = trimesh.visual.material.PBRMaterial(
        baseColorTexture=Image.fromarray(pixels), baseColorFactor=[64, 255, 255, 255], metallicFactor=0.0
    )
    (part,) = written_and_read(tmp_path, trimesh.visual.TextureVisuals(uv=np.eye(8, 2), material=textured)).parts
    assert part.material.texture is not None
    assert part.uv is not None
    expected = [200.0 * (64 / 255) ** (1.0 / 2.2), 200.0, 200.0]
    np.testing.assert_allclose(part.material.texture[0, 0], expected, atol=2.0)


def test_face_colours_become_parts(tmp_path: Path) -> None:
    colors = np.array([[200, 10, 10, 255]] * 6 + [[1, 1, 1, 255]] * 6, np.uint8)
    mesh = written_and_read(tmp_path, trimesh.visual.ColorVisuals(face_colors=colors), ".ply")
    found = sorted(part.material.color for part in mesh.parts)
    np.testing.assert_allclose(
        found, [[0.0002] * 3, [(200 / 255) ** 2.2, (10 / 255) ** 2.2, (10 / 255) ** 2.2]], atol=1e-3
    )
    assert mesh.face_count == 12
    sphere = trimesh.creation.icosphere(subdivisions=4)
    random_colors = np.random.default_rng(0).integers(0, 256, (len(sphere.faces), 4)).astype(np.uint8)
    sphere.visual = trimesh.visual.ColorVisuals(mesh=sphere, face_colors=random_colors)
    sphere.export(tmp_path / "random_colors.ply")
    many = mesh_files.load_mesh(tmp_path / "random_colors.ply")
    assert 8 <= len(many.parts) <= 64
    assert many.face_count == len(sphere.faces)


def test_mesh_of_planet_size_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "planet.ply"
    trimesh.creation.icosphere(subdivisions=1, radius=RADIUS_EARTH).export(path)
    with pytest.raises(MeshError, match="span"):
        mesh_files.load_mesh(path)
