"""Surface of the target from a scenario: hull, packaged mesh, mesh file; and what is refused in one line."""

from pathlib import Path

import numpy as np
import pytest

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.trained import coverage_surface

_CUBE = "".join(f"v {x} {y} {z}\n" for x in (-300, 300) for y in (-300, 300) for z in (-300, 300)) + "".join(
    f"f {face}\n" for face in ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
)


def triangles(*overrides: str) -> np.ndarray:
    file = scenario_loader.load("inspection", ["coverage.enabled=true", *overrides])
    return coverage_surface.surface_triangles(file.model_dump())


def area_and_volume(surface: np.ndarray) -> tuple[float, float]:
    a, b, c = np.moveaxis(surface, 1, 0)
    doubled = np.cross(b - a, c - a)
    return 0.5 * np.linalg.norm(doubled, axis=1).sum(), np.sum(a * np.cross(b, c)) / 6.0


def test_hull_is_closed_and_faces_outwards() -> None:
    from scipy.spatial import ConvexHull

    surface = triangles("coverage.surface=hull")
    hull = ConvexHull(np.array(scenario_loader.load("inspection").target.hull_m))
    # A volume that is positive, and that of the hull: all triangles are counter-clockwise from outside.
    assert area_and_volume(surface) == pytest.approx((hull.area, hull.volume), rel=1e-12)


def test_packaged_surface_is_that_of_the_packaged_target() -> None:
    surface = triangles()
    np.testing.assert_allclose(np.ptp(surface[:, :, 1]), 1.6, atol=1e-9)
    # Bus of 0.145 m3, two panels of 4.5 l with cells.
    assert area_and_volume(surface)[1] == pytest.approx(0.16, rel=0.03)


def test_mesh_file_in_its_unit_relative_to_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "cube.obj").write_text(_CUBE)
    scenario = tmp_path / "cube.toml"
    scenario.write_text('extends = "inspection"\n[coverage]\nenabled = true\nsurface = "cube.obj"\nmesh_units = "mm"\n')
    file = scenario_loader.load(scenario)
    surface = coverage_surface.surface_triangles(file.model_dump())
    assert area_and_volume(surface) == pytest.approx((6 * 0.36, 0.216))
    # The content of the file counts, not its name.
    digest = scenario_digest(file)
    (tmp_path / "cube.obj").write_text(_CUBE.replace("300", "310"))
    assert scenario_digest(file) != digest


def test_coverage_counts_in_the_digest_only_where_it_is_on() -> None:
    def digest(*overrides: str) -> str:
        return scenario_digest(scenario_loader.load("inspection", list(overrides)))

    assert digest("coverage.facet_size_m=0.2") == digest()
    assert digest("coverage.enabled=true") != digest()
    assert digest("coverage.enabled=true", "coverage.facet_size_m=0.2") != digest("coverage.enabled=true")


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["coverage.surface=none.glb"], r"coverage\.surface: found '.*none\.glb', expected 'packaged', 'hull' or"),
        (["coverage.facet_size_m=0.001"], r"coverage\.facet_size_m: found 0\.001, expected at least 0\.016"),
        (["coverage.surface=hull", f"target.hull_m={[[0.0, 0.0, float(i)] for i in range(5)]}"], r"target\.hull_m"),
    ],
)
def test_unusable_surfaces_are_refused(overrides: list[str], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        triangles(*overrides)


def test_requirement_on_coverage_needs_coverage(tmp_path: Path) -> None:
    scenario = tmp_path / "covered.toml"
    requirement = '[[requirements]]\nmetric = "surface_seen_fraction"\nbound = "at least"\nlimit = 0.9\n'
    scenario.write_text(f'extends = "inspection"\n{requirement}probability = 0.5\nconsumer_risk = 0.1\n')
    with pytest.raises(ScenarioError, match=r"requirements\.\d+\.metric: .* needs coverage\.enabled = true"):
        scenario_loader.load(scenario)
    assert scenario_loader.load(scenario, ["coverage.enabled=true"]).coverage.enabled
