"""Meshes come in as they are meant, or with one line that says what is wrong."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from rpojax.core.constants import RADIUS_EARTH
from rpojax.errors import RpojaxError
from rpojax.optional import MissingExtraError, require_package
from rpojax.scenario.schema import ScenarioFile
from rpojax.training.synthetic_data.meshes import mesh_files, packaged_target, target_mesh
from rpojax.training.synthetic_data.meshes.mesh_files import MeshError


def test_the_packaged_target_fills_the_hull_of_the_scenario(inspection_file: ScenarioFile) -> None:
    from scipy.spatial import ConvexHull

    hull = ConvexHull(np.array(inspection_file.model_dump()["target"]["hull_m"]))
    mesh = packaged_target.packaged_target()
    outside = mesh.vertices @ hull.equations[:, :3].T + hull.equations[:, 3]
    assert outside.max() < 0.06  # the nozzle stands out by 5 cm
    assert np.mean(outside < 0.03) > 0.9
    np.testing.assert_allclose(mesh.bounds[:, 1], [-0.8, 0.8], atol=1e-9)


def test_the_packaged_target_has_a_shiny_foil_among_several_materials() -> None:
    materials = [part.material for part in packaged_target.packaged_target().parts]
    assert len(materials) >= 5
    assert any(material.metallic == 1.0 and material.roughness < 0.4 for material in materials)


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".glb"])
def test_a_mesh_in_millimetres_off_centre_is_put_right_when_asked(tmp_path: Path, suffix: str) -> None:
    box = trimesh.creation.box(extents=(1000.0, 600.0, 400.0))
    box.apply_translation((5000.0, 0.0, 0.0))
    path = tmp_path / f"box{suffix}"
    box.export(path)
    mesh = mesh_files.load_mesh(path, units="mm", center=True)
    np.testing.assert_allclose(mesh.bounds, [[-0.5, -0.3, -0.2], [0.5, 0.3, 0.2]], atol=1e-6)
    with pytest.raises(MeshError, match="--units"):
        mesh_files.load_mesh(path, center=True)
    with pytest.raises(MeshError, match="--center"):
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
def test_a_file_that_is_no_mesh_is_an_error_of_one_line(tmp_path: Path, name: str, content: str, expected: str) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(MeshError, match=expected) as error:
        mesh_files.load_mesh(path)
    assert name in str(error.value)


def saved(tmp_path: Path, visual: object, suffix: str = ".glb") -> target_mesh.TargetMesh:
    """A box with a trimesh visual, as it comes back from a file."""
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
def test_a_material_of_gltf_is_what_the_format_says(
    tmp_path: Path, given: dict[str, Any], color: float, metallic: float, roughness: float
) -> None:
    material = trimesh.visual.material.PBRMaterial(**given)
    uv = np.zeros((8, 2))
    (part,) = saved(tmp_path, trimesh.visual.TextureVisuals(uv=uv, material=material)).parts
    np.testing.assert_allclose(part.material.color, color, atol=1e-3)
    assert (part.material.metallic, part.material.roughness) == (pytest.approx(metallic), pytest.approx(roughness))


def test_colours_of_obj_are_srgb_and_textures_are_kept(tmp_path: Path) -> None:
    from PIL import Image

    visual = trimesh.visual.material.SimpleMaterial(diffuse=[128, 0, 255, 255])
    (part,) = saved(tmp_path, trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=visual), ".obj").parts
    np.testing.assert_allclose(part.material.color, [(128 / 255) ** 2.2, 0.0002, 0.9], atol=2e-3)
    pixels = np.full((4, 4, 3), 200, np.uint8)
    textured = trimesh.visual.material.PBRMaterial(
        baseColorTexture=Image.fromarray(pixels), baseColorFactor=[64, 255, 255, 255], metallicFactor=0.0
    )
    (part,) = saved(tmp_path, trimesh.visual.TextureVisuals(uv=np.eye(8, 2), material=textured)).parts
    assert part.material.texture is not None
    assert part.uv is not None
    expected = [200.0 * (64 / 255) ** (1.0 / 2.2), 200.0, 200.0]
    np.testing.assert_allclose(part.material.texture[0, 0], expected, atol=2.0)


def test_faces_of_several_colours_are_several_parts(tmp_path: Path) -> None:
    colors = np.array([[200, 10, 10, 255]] * 6 + [[1, 1, 1, 255]] * 6, np.uint8)
    mesh = saved(tmp_path, trimesh.visual.ColorVisuals(face_colors=colors), ".ply")
    found = sorted(part.material.color for part in mesh.parts)
    np.testing.assert_allclose(
        found, [[0.0002] * 3, [(200 / 255) ** 2.2, (10 / 255) ** 2.2, (10 / 255) ** 2.2]], atol=1e-3
    )
    assert mesh.face_count == 12
    sphere = trimesh.creation.icosphere(subdivisions=4)
    rainbow = np.random.default_rng(0).integers(0, 256, (len(sphere.faces), 4)).astype(np.uint8)
    sphere.visual = trimesh.visual.ColorVisuals(mesh=sphere, face_colors=rainbow)
    sphere.export(tmp_path / "rainbow.ply")
    many = mesh_files.load_mesh(tmp_path / "rainbow.ply")
    assert 8 <= len(many.parts) <= 64
    assert many.face_count == len(sphere.faces)


def test_a_mesh_as_large_as_a_planet_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "planet.ply"
    trimesh.creation.icosphere(subdivisions=1, radius=RADIUS_EARTH).export(path)
    with pytest.raises(MeshError, match="span"):
        mesh_files.load_mesh(path)


def test_surface_points_lie_on_the_surface(box: target_mesh.TargetMesh) -> None:
    points, normals = box.surface_points(0.05)
    half = np.array([0.5, 0.3, 0.2])
    np.testing.assert_allclose(np.max(np.abs(points) / half, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.sum(points * normals, axis=1), np.abs(normals) @ half, atol=1e-9)


def test_outline_and_size_of_the_packaged_target_are_those_of_the_scenario(inspection_file: ScenarioFile) -> None:
    tables = inspection_file.model_dump()
    size = tables["navigation"]["target_size_m"]
    # 4000 attitudes leave 0.5 % to chance.
    assert target_mesh.apparent_size(np.array(tables["target"]["hull_m"])) == pytest.approx(size, rel=0.01)
    hull = target_mesh.outline_vertices(packaged_target.packaged_target())
    assert 4 <= len(hull) <= 64
    # The nozzle and the dish stand out of the scenario's hull.
    assert target_mesh.apparent_size(hull) == pytest.approx(size, rel=0.05)


def test_the_outline_of_a_box_is_its_corners(box: target_mesh.TargetMesh) -> None:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.3, 0.3) for z in (-0.2, 0.2)])
    np.testing.assert_allclose(target_mesh.outline_vertices(box), corners, atol=1e-9)


def test_a_missing_extra_says_the_line_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mitsuba", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'rpojax\[raytrace\]'") as error:
        require_package("mitsuba")
    assert isinstance(error.value, RpojaxError)
    assert len(str(error.value).splitlines()) == 1
