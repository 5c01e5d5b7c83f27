"""Warnings about the mission of a team, or of a servicer alone, before it is simulated."""

from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import member_files, member_names
from rpojax.scenario.warnings import all_warnings
from rpojax.scenario.warnings.difference_beliefs import difference_warnings
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.link_uses import link_warnings


def mission_warnings(file: ScenarioFile) -> list[str]:
    """One line for each reason for which a mission may not work: key, found, expected.

    What holds for all servicers is said once, what holds for some begins with `servicers.NAME`.
    """
    if not file.servicers:
        return all_warnings.mission_warnings(file)
    found: dict[str, list[str]] = {}
    for name, member in zip(member_names(file), member_files(file), strict=True):
        for warning in _of_member(member, shares=file.navigation.sharing != "none"):
            found.setdefault(warning, []).append(name)
    lines: list[str] = []
    for warning, names in found.items():
        is_of_all = len(names) == len(file.servicers)
        lines += [warning] if is_of_all else [f"servicers.{name}.{warning}" for name in names]
    return lines


def _of_member(member: ScenarioFile, shares: bool) -> list[str]:
    warnings = all_warnings.mission_warnings(member)
    reach = DispersedReach(member)
    return [*warnings, *link_warnings(member, reach), *(difference_warnings(member, reach) if shares else [])]
