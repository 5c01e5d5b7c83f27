"""The packaged target against the packaged scenario."""

import sys

import numpy as np
import pytest

from rpojax.scenario.schema import ScenarioFile
from rpojax.training.synthetic_data.meshes import mesh_files, packaged_target, target_mesh


def test_packaged_target_fills_hull_of_scenario(inspection_file: ScenarioFile) -> None:
    from scipy.spatial import ConvexHull

    hull = ConvexHull(np.array(inspection_file.model_dump()["target"]["hull_m"]))
    mesh = packaged_target.packaged_target()
    outside = mesh.vertices @ hull.equations[:, :3].T + hull.equations[:, 3]
    assert outside.max() < 0.06  # the nozzle protrudes by 5 cm
    assert np.mean(outside < 0.03) > 0.9
    np.testing.assert_allclose(mesh.bounds[:, 1], [-0.8, 0.8], atol=1e-9)


def test_packaged_target_has_foil_among_several_materials() -> None:
    materials = [part.material for part in packaged_target.packaged_target().parts]
    assert len(materials) >= 5
    assert any(material.metallic == 1.0 and material.roughness < 0.4 for material in materials)


def test_outline_and_size_of_packaged_target_match_scenario(inspection_file: ScenarioFile) -> None:
    tables = inspection_file.model_dump()
    size = tables["navigation"]["target_size_m"]
    # 4000 random attitudes have a standard error of 0.5 %.
    assert target_mesh.apparent_size(np.array(tables["target"]["hull_m"])) == pytest.approx(size, rel=0.01)
    hull = target_mesh.outline_vertices(packaged_target.packaged_target())
    assert 4 <= len(hull) <= 64
    # The nozzle and the dish are outside of the hull of the scenario.
    assert target_mesh.apparent_size(hull) == pytest.approx(size, rel=0.05)


def test_packaged_target_needs_no_optional_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    mesh = mesh_files.load_mesh("target")
    triangles = np.concatenate([part.vertices[part.faces] for part in mesh.parts])
    # Bus, five plates, panels and cells, cylinders, ring, and the shells of two paraboloids: all face outwards.
    volumes = np.sum(triangles[:, 0] * np.cross(triangles[:, 1], triangles[:, 2]), axis=1) / 6.0
    assert volumes.sum() == pytest.approx(0.16145, rel=1e-3)
