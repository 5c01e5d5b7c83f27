"""Warnings about the mission of a team, or of a servicer alone, before it is simulated."""

import math

from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import member_files, member_names
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.filter_beliefs import Belief, judged_beliefs
from rpojax.scenario.warnings.link_uses import link_warnings
from rpojax.scenario.warnings.mission_warnings import mission_warnings as servicer_warnings


def mission_warnings(file: ScenarioFile) -> list[str]:
    """One line for each reason for which a mission may not work: key, found, expected.

    What holds for all servicers is said once, what holds for some begins with `servicers.NAME`.
    """
    if not file.servicers:
        return servicer_warnings(file)
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
    warnings = servicer_warnings(member)
    reach = DispersedReach(member)
    return [*warnings, *link_warnings(member, reach), *(difference_warnings(member, reach) if shares else [])]


def difference_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Beliefs in differences of GPS positions, of two receivers as this servicer's, and in ranges, that differ much."""

    def high(key: str) -> float:
        return float(reach.ends(key)[1])

    if file.gps_differences.kind == "carrier":
        noise_key, error_key = "gps_differences.noise_m", "gps_differences.slow_error_m"
        noise, error = high(noise_key), high(error_key)
    else:
        noise_key, error_key = "gps.noise_m", "gps.bias_sigma_m and common_share"
        own_share = 1.0 - float(reach.ends("gps.common_share")[0])
        noise, error = math.sqrt(2.0) * high(noise_key), math.sqrt(2.0 * own_share) * high("gps.bias_sigma_m")
    beliefs: list[Belief] = []
    for key, of_truth, truth in (
        ("navigation.difference_noise_m", noise_key, noise),
        ("navigation.difference_error_sigma_m", error_key, error),
    ):
        beliefs.append((key, of_truth, truth, float(reach.middle(key))))
    if file.link_range.enabled:
        for key in ("noise_m", "bias_sigma_m"):
            of_truth, belief = f"link_range.{key}", f"navigation.difference_range_{key}"
            beliefs.append((belief, of_truth, high(of_truth), float(reach.middle(belief))))
    return judged_beliefs(beliefs)
