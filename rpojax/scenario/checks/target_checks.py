"""Checks that what a scenario takes from the package of its target is of that target."""

from typing import Final

from rpojax.errors import ScenarioError
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.trained.coverage_surface import is_surface_used
from rpojax.scenario.trained.packaged_hull import is_like_packaged, is_packaged
from rpojax.scenario.trained.trained_files import PACKAGED

_OTHER: Final = "as target.hull_m is not that of the packaged one"


def check_target(file: ScenarioFile) -> None:
    """Refuses packaged pictures, camera statistics and surface for a target with another hull than the packaged one.

    A hull of nearly the same size may have the packaged pictures and surface; a warning says so.

    Raises:
        ScenarioError: naming the key that says `packaged`.
    """
    if is_packaged(file.target.hull_m):
        return
    model, is_like = file.camera.model, is_like_packaged(file.target.hull_m)
    if model == "statistical" and file.imaging.statistics == PACKAGED:
        expected = f"a file of this target that `rpojax calibrate-camera-model` wrote, {_OTHER}"
        raise ScenarioError("imaging.statistics", PACKAGED, expected)
    if model == "rendered" and not is_like:
        check_field(file)
    if is_surface_used(file.model_dump()) and file.coverage.surface == PACKAGED and not is_like:
        raise ScenarioError("coverage.surface", PACKAGED, f"'hull' or the path of a mesh of this target, {_OTHER}")


def check_field(file: ScenarioFile) -> None:
    """Refuses the packaged radiance field for pictures of a target with another hull.

    Raises:
        ScenarioError: naming the key.
    """
    if file.imaging.field == PACKAGED and not is_like_packaged(file.target.hull_m):
        expected = f"a field of this target that `rpojax field train` wrote, {_OTHER}"
        raise ScenarioError("imaging.field", PACKAGED, expected)
