"""All warnings about the mission of one servicer before it is simulated."""

from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.trained.coverage_surface import surface_warnings
from rpojax.scenario.warnings.control_authority import control_warnings
from rpojax.scenario.warnings.dispersed_reach import DispersedReach, bound_warnings
from rpojax.scenario.warnings.filter_beliefs import belief_warnings
from rpojax.scenario.warnings.keep_out_drift import keep_out_warnings
from rpojax.scenario.warnings.phase_warnings import phase_warnings
from rpojax.scenario.warnings.target_frame_warnings import target_frame_warnings
from rpojax.scenario.warnings.target_light import light_warnings
from rpojax.scenario.warnings.target_size import (
    other_target_warnings,
    packaged_picture_warnings,
    shape_warnings,
    small_box_warnings,
)
from rpojax.time_scales import instant, leap_seconds_are_known


def mission_warnings(file: ScenarioFile) -> list[str]:
    """One line for each reason for which a mission may not work as the scenario declares it: key, found, expected."""
    reach = DispersedReach(file)
    found = [
        *bound_warnings(file, reach),
        *small_box_warnings(file, reach),
        *shape_warnings(file),
        *packaged_picture_warnings(file),
        *other_target_warnings(file),
        *light_warnings(file, reach),
        *keep_out_warnings(file, reach),
        *control_warnings(file, reach),
        *phase_warnings(file, reach),
        *target_frame_warnings(file, reach),
        *belief_warnings(file, reach),
        *leap_second_warnings(file),
        *surface_warnings(file.model_dump()),
    ]
    # With phases the station of `formation` is not used.
    return [each for each in found if not (file.phases and "formation.desired_position_m" in each)]


def leap_second_warnings(file: ScenarioFile) -> list[str]:
    """One line where UTC at the start assumes that no leap second comes after those known."""
    year = int(instant(file.epoch_utc).utc()[:4])
    if leap_seconds_are_known(year):
        return []
    last = next(each for each in range(year, 0, -1) if leap_seconds_are_known(each))
    return [
        f"epoch_utc: found {year}, expected a year to {last}, since leap seconds after it are not known and none is "
        "assumed; each turns the Sun by 2e-7 rad"
    ]
