"""Checks of the phases of a mission: names, periods, ends, and references within the limits of the phase."""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.errors import ScenarioError
from rpojax.flight.guidance.references import relative_orbit
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.flight.guidance.references.relative_orbit import RelativeOrbit
from rpojax.flight.mission.static_mission_settings import BUILT_IN_PHASES
from rpojax.scenario.numbers.section_records import section_record
from rpojax.scenario.phases import reference_sections as kinds
from rpojax.scenario.phases.phase_sections import LASTING_KEYS, NO_GOAL, CorridorSection, PhaseSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.control_authority import largest_delta_v_m_s
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.nominal_motion import at_latitudes, mean_motion, orbit_from
from rpojax.scenario.warnings.transfer_impulses import transfer_impulses

_ANGLES = np.linspace(0.0, 2.0 * np.pi, 361)
_NEARLY_CIRCULAR = 0.01
"""Eccentricity up to which a drift is that of a circular orbit."""


def check_phases(file: ScenarioFile) -> None:
    """Checks the phases of a scenario, its mission section and its goal.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    _check_goal(file)
    if not file.phases:
        if file.mission != type(file.mission)():
            raise ScenarioError("mission", "settings", "them only in a scenario with [[phases]]")
        return
    names = [phase.name for phase in file.phases]
    for phase in file.phases:
        if names.count(phase.name) > 1 or phase.name in (*BUILT_IN_PHASES, NO_GOAL):
            expected = f"a name that no other phase has, and none of {', '.join((*BUILT_IN_PHASES, NO_GOAL))}"
            raise ScenarioError("phases.name", phase.name, expected)
    _check_periods(file)
    place: np.ndarray | None = np.array(file.initial.relative_position_m)
    _check_start(file, place)
    frame = file.phases[0].frame
    for phase in file.phases:
        # Where the frame changes, nobody knows before flight where the phase begins.
        place, frame = (place if phase.frame == frame else None), phase.frame
        _check_end(file, phase)
        _check_speeds(phase)
        _check_keep_out(file, phase, place)
        if isinstance(phase.reference, kinds.TransferSection) and place is not None:
            _check_transfer(file, phase.name, phase.reference, place)
        place = _end_m(phase)


def _check_goal(file: ScenarioFile) -> None:
    """Refuses a goal that no run can reach."""
    phase, at = file.goal.phase, file.goal.at
    known = (*file.phase_names, NO_GOAL)
    if phase is not None and phase not in known:
        expected = f"one of {', '.join(known)}" if file.phases else f"{NO_GOAL} in a scenario without [[phases]]"
        raise ScenarioError("goal.phase", phase, expected)
    if at is not None and (not file.phases or phase == NO_GOAL):
        raise ScenarioError("goal.at", at, "it only beside a phase")
    name = phase or (file.phases[-1].name if file.phases else None)
    if at == "end" and not any(each.name == name and each.until is not None for each in file.phases):
        raise ScenarioError("goal.at", at, f"begin, as phase {name} has no conditions until that end it")


def _check_periods(file: ScenarioFile) -> None:
    decision, camera = file.mission.decision_period_s, file.rates.camera_hz
    _check_multiple("mission.decision_period_s", decision, 1.0 / camera, "camera periods")
    default, limit, lead = file.rates.formation_period_s, file.pointing.look_away_limit_s, file.formation.lead_s
    if decision > lead:
        expected = f"at most formation.lead_s = {lead:g}: an abort looks ahead by twice that, and burns a lead later"
        raise ScenarioError("mission.decision_period_s", decision, expected)
    _check_multiple("rates.formation_period_s", default, decision, "mission.decision_period_s")
    for phase in file.phases:
        key, period = f"phases.{phase.name}.control_period_s", phase.control_period_s or default
        _check_control(file, phase)
        _check_multiple(key, period, decision, "mission.decision_period_s")
        if phase.control == "burns" and period < lead + 0.5 * limit:
            expected = f"at least {lead + 0.5 * limit:g}, formation.lead_s and half of pointing.look_away_limit_s"
            raise ScenarioError(key, period, expected)


def _check_control(file: ScenarioFile, phase: PhaseSection) -> None:
    """Refuses continuous control without thrusters for it, and a period beside it, which has no meaning."""
    key = f"phases.{phase.name}"
    if phase.control == "burns":
        return
    if not file.thrusters:
        raise ScenarioError(f"{key}.control", phase.control, "'burns', or [[thrusters]] that need no turns")
    if phase.control_period_s is not None:
        expected = "no period: continuous control decides anew in each camera period"
        raise ScenarioError(f"{key}.control_period_s", phase.control_period_s, expected)


def _check_multiple(key: str, value: float, unit: float, name: str) -> None:
    ratio = value / unit
    if ratio < 0.5 or not math.isclose(ratio, round(ratio), rel_tol=1e-9):
        raise ScenarioError(key, value, f"a whole number of {name} ({unit:g} s)")


def _check_end(file: ScenarioFile, phase: PhaseSection) -> None:
    """Refuses a phase before the last one that can never end."""
    key = f"phases.{phase.name}"
    given = phase.until.model_dump() if phase.until else {}
    if phase.until is not None and not given:
        raise ScenarioError(f"{key}.until", "no condition", "at least one, such as time_s")
    for name, needs in LASTING_KEYS.items():
        if name in given and needs not in given:
            raise ScenarioError(f"{key}.until.{name}", given[name], f"it only beside {needs}")
    is_last = phase is file.phases[-1]
    if phase.timeout_s is None and not is_last and not given:
        raise ScenarioError(key, "a phase that never ends", "until or timeout_s, as other phases follow")
    latest = {"until.time_s": given.get("time_s"), "until.ground_go_s": given.get("ground_go_s")}
    for name, value in {**latest, "timeout_s": phase.timeout_s}.items():
        if value is not None and value > file.duration_s and (name != "timeout_s" or (not given and not is_last)):
            raise ScenarioError(f"{key}.{name}", value, f"an end within the run: duration_s = {file.duration_s:g}")
    if phase.timeout_s is None:
        return
    for name in ("time_s", *LASTING_KEYS):
        if phase.timeout_s < given.get(name, 0.0):
            expected = f"at least until.{name} = {given[name]:g}, before which the phase cannot end otherwise"
            raise ScenarioError(f"{key}.timeout_s", phase.timeout_s, expected)
    if not given and not is_last and phase.on_timeout != "next":
        expected = "next, or until, as other phases follow and nothing else leads to them"
        raise ScenarioError(f"{key}.on_timeout", phase.on_timeout, expected)


def _check_speeds(phase: PhaseSection) -> None:
    """Refuses an approach whose last speed is above its greatest."""
    match phase.reference:
        case kinds.ApproachSection(final_speed_m_s=final, max_speed_m_s=greatest) if final > greatest:
            key = f"phases.{phase.name}.reference.final_speed_m_s"
            raise ScenarioError(key, final, f"at most max_speed_m_s = {greatest:g}")


def _check_start(file: ScenarioFile, start: np.ndarray) -> None:
    """Refuses a start inside of the keep-out zone of the first phase."""
    zone = file.phases[0].keep_out_m
    if zone and np.linalg.norm(start / np.maximum(zone, 1e-9)) < 1.0:
        expected = f"a start outside of phases.{file.phases[0].name}.keep_out_m = {list(zone)}"
        raise ScenarioError("initial.relative_position_m", start.tolist(), expected)


def _check_keep_out(file: ScenarioFile, phase: PhaseSection, start: np.ndarray | None) -> None:
    """Refuses a reference inside of its keep-out zone or outside of its corridor, from its `start` [m] where known."""
    if phase.keep_out_m and min(phase.keep_out_m) < file.limits.keep_out_m:
        expected = f"at least limits.keep_out_m = {file.limits.keep_out_m:g} m, by which runs are judged"
        raise ScenarioError(f"phases.{phase.name}.keep_out_m", list(phase.keep_out_m), expected)
    margin = file.mission.abort_margin_m
    semi_axes = np.array(phase.keep_out_m or 3 * [file.limits.keep_out_m]) + margin
    if phase.frame == "target":
        # The ellipsoid is in H: each of its axes may be anywhere in the turning frame.
        semi_axes = np.full(3, semi_axes.max())
    places = _places(file, phase, start)
    key = f"phases.{phase.name}.reference"
    if len(places) and (clearance := np.min(np.linalg.norm(places / np.maximum(semi_axes, 1e-9), axis=1))) < 1.0:
        expected = f"one outside of the keep-out zone of {semi_axes.max():g} m, mission.abort_margin_m included"
        raise ScenarioError(key, f"{phase.reference.kind} at {clearance:.2g} of its radius", expected)
    if phase.corridor is None:
        return
    axis = np.array(phase.corridor.axis) / np.linalg.norm(phase.corridor.axis)
    outside = [place for place in places if not _in_corridor(phase.corridor, axis, place)]
    if outside:
        found = [round(float(each), 1) for each in outside[0]]
        expected = f"a way inside of phases.{phase.name}.corridor"
        raise ScenarioError(key, f"{phase.reference.kind} through {found} m", expected)


def _in_corridor(corridor: CorridorSection, axis: np.ndarray, place: np.ndarray) -> bool:
    ahead = float(axis @ place)
    aside = float(np.linalg.norm(place - ahead * axis))
    return ahead >= 0.0 and aside <= corridor.width_m + ahead * math.tan(math.radians(corridor.half_angle_deg))


def _places(file: ScenarioFile, phase: PhaseSection, start: np.ndarray | None) -> np.ndarray:
    """Places (n, 3) [m] of a reference that are known before flight."""
    match phase.reference:
        case kinds.HoldSection(position_m=place):
            return np.array([place])
        case kinds.ArcSection(position_m=place):
            # No nearer on the way than at its ends.
            return np.array([place])
        case kinds.TransferSection() as transfer:
            return np.array([transfer.position_m]) if start is None else transfer_impulses(file, transfer, start).way
        case kinds.ApproachSection(end_position_m=place):
            return np.array([place]) if start is None else np.linspace(start, place, len(_ANGLES))
        case kinds.RelativeOrbitSection() as orbit:
            return _relative_orbit_places(file, orbit, min(phase.timeout_s or math.inf, file.duration_s))
        case kinds.FlyAroundSection() as circle:
            axis = np.array(circle.axis) / np.linalg.norm(circle.axis)
            first = np.linalg.svd(axis[None])[2][1:]
            turns = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
            return circle.radius_m * turns @ first
        case _:
            return np.zeros((0, 3))


def _relative_orbit_places(file: ScenarioFile, section: kinds.RelativeOrbitSection, longest_s: float) -> np.ndarray:
    """Places (n, 3) [m] of a relative orbit over a time.

    Of a drift they are, at each height of the motion, the ends of the way along the track and the place at which it
    passes the target. None are known of a drift on an elliptic orbit, where it changes the radial motion, too.
    """
    if section.drift_per_orbit_m and file.orbit.eccentricity > _NEARLY_CIRCULAR:
        return np.zeros((0, 3))
    drift = section.drift_per_orbit_m * longest_s * mean_motion(file) / (2.0 * np.pi)
    first, last = (
        np.array(_places_of_orbit(section_record(RelativeOrbit, section.model_dump() | changes), orbit_from(file, 0.0)))
        for changes in ({"join_s": 0.0}, {"join_s": 0.0, "along_track_m": section.along_track_m + drift})
    )
    if not drift:
        return first
    nearest = first.copy()
    nearest[:, 1] = np.clip(0.0, np.minimum(first, last)[:, 1], np.maximum(first, last)[:, 1])
    return np.concatenate([first, nearest, last])


@jax.jit
def _places_of_orbit(reference: RelativeOrbit, orbit: TargetOrbit) -> Float[Array, "n 3"]:
    """Positions [m] of a relative orbit all round the orbit of the target."""

    def place(there: TargetOrbit) -> Array:
        entry = PhaseEntry(relative_state=jnp.zeros(6), orbit=there)
        return relative_orbit.state(reference, entry, there, jnp.zeros(()))[:3]

    return jax.vmap(place)(at_latitudes(orbit, jnp.asarray(_ANGLES)))


def _end_m(phase: PhaseSection) -> np.ndarray | None:
    """Position at which the next phase begins, None where it is not known before flight."""
    match phase.reference:
        case (
            kinds.HoldSection(position_m=end) | kinds.TransferSection(position_m=end) | kinds.ArcSection(position_m=end)
        ):
            return np.array(end)
        case kinds.ApproachSection(end_position_m=end):
            return np.array(end)
        case _:
            return None


def _check_transfer(file: ScenarioFile, name: str, transfer: kinds.TransferSection, start: np.ndarray) -> None:
    """Refuses a transfer whose impulses the thruster cannot give within the look-away limit."""
    flown = transfer_impulses(file, transfer, start)
    reach = DispersedReach(file)
    last = len(flown.impulses) - 1
    for number, (impulse, place) in enumerate(zip(flown.impulses, flown.points, strict=True)):
        largest = float(largest_delta_v_m_s(file, reach, -place, impulse))
        if (size := float(np.linalg.norm(impulse))) > largest:
            which = "first" if number == 0 else "last" if number == last else f"{number + 1}th"
            found = f"a {which} impulse of {1e3 * size:.3g} mm/s"
            limits = "which thruster and look-away limit give; more pulses or a longer duration split it"
            expected = f"at most {1e3 * largest:.3g} mm/s, {limits}"
            raise ScenarioError(f"phases.{name}.reference.duration_s", found, expected)
