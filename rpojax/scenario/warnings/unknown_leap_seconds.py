"""Warning about a start so far ahead that its leap seconds are not known."""

from rpojax.scenario.schema import ScenarioFile
from rpojax.time_scales import instant, leap_seconds_are_known


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
