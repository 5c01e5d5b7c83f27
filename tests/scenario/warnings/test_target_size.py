"""Pictures and surfaces of another target than that of the hull are told."""

from pathlib import Path

import numpy as np
import pytest

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.trained import trained_files
from rpojax.scenario.warnings.target_size import other_target_warnings

HULL = "target.hull_m=[" + ",".join(f"[{x},{y},{z}]" for x in (-1, 1) for y in (-0.5, 0.5) for z in (-0.5, 0.5)) + "]"


def box_mesh(path: Path, sides: tuple[float, float, float]) -> Path:
    """Wavefront file of a box about the origin."""
    corners = 0.5 * np.array(sides) * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))
    lines = [*("v {} {} {}".format(*corner) for corner in corners), *("f {} {} {} {}".format(*quad) for quad in quads)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("sides", "told"),
    [
        ((2.0, 1.0, 1.0), None),
        ((2.2, 1.1, 1.1), None),
        ((5.0, 2.5, 2.5), "found a target of 5 x 2.5 x 2.5 m, expected that of target.hull_m, 2 x 1 x 1 m"),
        ((1.0, 2.0, 1.0), "found a target of 1 x 2 x 1 m"),
    ],
)
def test_a_mesh_of_another_size_or_axes_is_told(
    tmp_path: Path, sides: tuple[float, float, float], told: str | None
) -> None:
    mesh = box_mesh(tmp_path / "box.obj", sides)
    entries = [HULL, "coverage.enabled=true", "coverage.facet_size_m=0.2", f"coverage.surface={mesh}"]
    found = other_target_warnings(scenario_loader.load("inspection", entries))
    assert len(found) == (told is not None)
    assert told is None or found[0].startswith("coverage.surface: ")
    assert told is None or told in found[0]


def test_what_comes_from_the_package_for_its_target_is_not_told() -> None:
    entries = ["camera.model=rendered", "coverage.enabled=true", "coverage.surface=packaged"]
    assert other_target_warnings(scenario_loader.load("inspection", entries)) == []
    same = trained_files.file_path(scenario_loader.load("inspection").model_dump(), "field")
    own = ["camera.model=rendered", f"imaging.field={same}"]
    assert other_target_warnings(scenario_loader.load("inspection", own)) == []
    larger = scenario_loader.load("inspection", [HULL, *own])
    assert "imaging.field: found a target of 0.583 x 1.65 x 0.669 m" in other_target_warnings(larger)[0]
