"""Whether the phases of a mission can be flown: by the thruster, with their pointing, and within the run."""

import math

import numpy as np

from rpojax.scenario.phases import reference_sections as kinds
from rpojax.scenario.phases.phase_sections import LASTING_KEYS, PhaseSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.control_authority import largest_delta_v_m_s
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.transfer_impulses import nearest_regular, sensitivity, share_of_singular_places

_AHEAD = np.array([1.0, 0.0, 0.0])
_DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])


def phase_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Phases that begin after the run, that no burn can follow or few can, and aborts that no burn can make."""
    if not file.phases:
        return []
    found = _abort_warnings(file, reach) + _time_warnings(file)
    for phase in file.phases:
        found += _pointing_warnings(phase) + _speed_warnings(file, reach, phase) + _singular_warnings(file, phase)
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
        lasting = [times.get(name) or 0.0 for name in ("time_s", *LASTING_KEYS)]
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
    rests = isinstance(phase.reference, kinds.HoldSection | kinds.RelativeOrbitSection)
    moves = phase.frame == "target" or not rests
    if phase.pointing == "target" or not moves:
        return []
    return [
        f"phases.{phase.name}.pointing: {phase.pointing} allows no burns, expected target to follow a "
        f"reference of kind {phase.reference.kind}"
    ]


def _singular_warnings(file: ScenarioFile, phase: PhaseSection) -> list[str]:
    """Times between impulses after which one of them hardly moves the servicer along some direction."""
    found = []
    if isinstance(phase.reference, kinds.TransferSection):
        arcs = phase.reference.pulses - 1
        interval = phase.reference.duration_s / arcs
        between = "" if arcs == 1 else f" ({interval:g} s between impulses)"
        if share_of_singular_places(file, interval) > 0.5:
            found.append(
                f"phases.{phase.name}.reference.duration_s: after {phase.reference.duration_s:g} s{between}, near half "
                "turns across the track or whole ones in the plane, two impulses hardly reach some positions: a metre "
                f"takes {_millimetres(file, interval)} mm/s of them, so that a third one is made on the way; "
                f"expected {_regular(file, interval, arcs)} for two"
            )
    period = phase.control_period_s or file.rates.formation_period_s
    if share_of_singular_places(file, period) > 0.5:
        key = f"phases.{phase.name}.control_period_s" if phase.control_period_s else "rates.formation_period_s"
        found.append(
            f"{key}: burns {period:g} s apart, near half turns across the track or whole ones in the plane, hardly "
            f"correct some errors: a metre takes {_millimetres(file, period)} mm/s; "
            f"expected {_regular(file, period, 1)}"
        )
    return found


def _millimetres(file: ScenarioFile, seconds: float) -> str:
    size = 1e3 * sensitivity(file, seconds)
    return f"{size:.3g}" if size < 1e4 else "more than 10000"


def _regular(file: ScenarioFile, seconds: float, arcs: int) -> str:
    shorter, longer = nearest_regular(file, seconds)
    below = [] if shorter is None else [f"at most {math.floor(arcs * shorter)} s"]
    above = [] if longer is None else [f"at least {math.ceil(arcs * longer)} s"]
    return " or ".join([*below, *above]) or "a time more than an orbit away"


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
