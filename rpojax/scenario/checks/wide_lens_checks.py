"""Checks of the second lens of the camera."""

from rpojax.errors import ScenarioError
from rpojax.scenario.checks.ranging_checks import nearest_station_m
from rpojax.scenario.schema import ScenarioFile


def check_wide_lens(file: ScenarioFile) -> None:
    """Refuses a lens that is not wider or is never used, and scenarios that do not know two.

    Raises:
        ScenarioError: naming the key.
    """
    lens = file.wide_lens
    if lens is None:
        return
    own = file.camera.field_of_view_deg
    if lens.field_of_view_deg <= own:
        expected = f"more than camera.field_of_view_deg = {own:g}"
        raise ScenarioError("wide_lens.field_of_view_deg", lens.field_of_view_deg, expected)
    if lens.return_range_m <= lens.switch_range_m:
        expected = f"more than switch_range_m = {lens.switch_range_m:g}, or the lenses would change at every tick"
        raise ScenarioError("wide_lens.return_range_m", lens.return_range_m, expected)
    nearest = nearest_station_m(file)
    if nearest is not None and lens.switch_range_m <= nearest:
        expected = f"more than {nearest:g}, the distance of the nearest station from the target"
        raise ScenarioError("wide_lens.switch_range_m", lens.switch_range_m, expected)
    if file.servicers:
        raise ScenarioError("wide_lens", "a second lens with [[servicers]]", "one lens for all boxes of a team")
    if file.coverage.enabled:
        raise ScenarioError("coverage.enabled", True, "false with [wide_lens]: coverage is that through one lens")
