"""Whether the phases of a mission can be flown: by the thruster, with their pointing, and within the run."""

import math

import numpy as np

from rpojax.scenario.phases import reference_sections as kinds
from rpojax.scenario.phases.phase_sections import PhaseSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.control_authority import largest_delta_v_m_s
from rpojax.scenario.warnings.dispersed_reach import DispersedReach

_AHEAD = np.array([1.0, 0.0, 0.0])
_DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])


def phase_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Phases that begin after the run, that no burn can follow, and aborts that no burn can make."""
    if not file.phases:
        return []
    found = _abort_warnings(file, reach) + _time_warnings(file)
    for phase in file.phases:
        found += _pointing_warnings(phase) + _speed_warnings(file, reach, phase)
    return found


def _abort_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Abort and veto turn by up to half a circle before their burn."""
    if float(largest_delta_v_m_s(file, reach, _AHEAD, -_AHEAD)) > 0.0:
        return []
    return [
        "pointing.look_away_limit_s: no burn is left of it after a turn by 180 deg and back (0 mm/s), expected some: "
        "aborts and changed burns may need any direction"
    ]


def _time_warnings(file: ScenarioFile) -> list[str]:
    """The first phase that begins after the run, or the last if it ends so, if those before take what they must."""
    begin = 0.0
    for phase, following in zip(file.phases, [*file.phases[1:], None], strict=True):
        times = phase.until.model_dump() if phase.until else {}
        lasting = [times.get(name) or 0.0 for name in ("time_s", "arrival_for_s", "range_sigma_for_s")]
        least = max(*lasting, (times.get("ground_go_s") or 0.0) - begin)
        if following is not None and phase.timeout_s and phase.on_timeout == "next":
            least = min(least, phase.timeout_s) if times else phase.timeout_s
        begin += least
        if begin >= file.duration_s:
            name, event = (phase.name, "ends") if following is None else (following.name, "begins")
            at = f"{event} {begin:g} s after the start at the earliest"
            return [f"phases.{name}: {at}, expected within duration_s = {file.duration_s:g}"]
    return []


def _pointing_warnings(phase: PhaseSection) -> list[str]:
    moves = not isinstance(phase.reference, kinds.HoldSection | kinds.RelativeOrbitSection)
    if phase.pointing == "target" or not moves:
        return []
    return [
        f"phases.{phase.name}.pointing: {phase.pointing} allows no burns, expected target to follow a "
        f"reference of kind {phase.reference.kind}"
    ]


def _speed_warnings(file: ScenarioFile, reach: DispersedReach, phase: PhaseSection) -> list[str]:
    """Speeds that one burn can neither reach nor stop, and circles whose turn in a control period is beyond a burn.

    What a burn gives is that in the best direction, with the longest turn that a thruster off the boresight may need.
    """
    match phase.reference:
        case kinds.ApproachSection(max_speed_m_s=needed):
            key = "max_speed_m_s"
        case kinds.RetreatSection(speed_m_s=needed):
            key = "speed_m_s"
        case kinds.FlyAroundSection(radius_m=radius, rate_deg_h=rate_deg_h):
            key, rate = "rate_deg_h", abs(math.radians(rate_deg_h)) / 3600.0
            half_turn = min(0.5 * rate * (phase.control_period_s or file.rates.formation_period_s), 0.5 * math.pi)
            needed = 2.0 * radius * rate * math.sin(half_turn)
        case _:
            return []
    available = float(np.max(largest_delta_v_m_s(file, reach, _AHEAD, _DIRECTIONS)))
    if needed <= available:
        return []
    return [
        f"phases.{phase.name}.reference.{key}: takes {1e3 * needed:.3g} mm/s in a burn, expected at most "
        f"{1e3 * available:.3g} mm/s, what the thruster gives within pointing.look_away_limit_s, turns included"
    ]
