"""Causes in the mission: corridor, keep-out zone, aborts, phases that never end, runs that are too short."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from rpojax.analysis.failure_causes import navigation_rules
from rpojax.analysis.failure_causes.finding import Depth, Finding, median, number, percent
from rpojax.analysis.failure_causes.present_values import change
from rpojax.analysis.failure_causes.run_evidence import Flags, Numbers, RunEvidence
from rpojax.flight.mission.mission_state import AbortReason, Condition
from rpojax.scenario.phases.phase_sections import CONDITION_KEYS, LASTING_KEYS, PhaseSection
from rpojax.simulation.outcomes.outcome_kinds import Outcome

_CERTAIN: Final = 2.0
_WEAK: Final = 1.0
_LEAST_ANGLE_DEG, _LEAST_WIDTH_M = 5.0, 1.0
"""Of a wider corridor. A choice: `vbar_approach` has 10 deg and 1.5 m."""
_ENDS: Final = {
    AbortReason.TIMEOUT: "a longer phases.PHASE.timeout_s, or a condition that it can meet",
    AbortReason.KEEP_OUT_PREDICTED: "a smaller limits.keep_out_m, a slower approach, or a relative orbit",
    AbortReason.TARGET_LOST: "see what the camera saw before the abort",
    AbortReason.CONFIDENCE_LOST: "what navigation believes: no health test was recorded",
    AbortReason.THRUSTER_FAILED: "a second thruster, or a longer formation.thruster_retry_s",
    AbortReason.COMMAND: "a goal.phase that allows for it",
    AbortReason.ATTITUDE_LOST: "a smaller until.attitude_sigma_deg before the target's frame is followed, or light and "
    "lens that show landmarks up to the end of the way (landmarks.minimum_size_px, wide_lens, lamp)",
}


def findings(evidence: RunEvidence) -> Iterator[Finding]:
    """Findings of the runs; none without phases, but for those that end before they are judged."""
    if evidence.phases:
        yield from corridors(evidence)
        yield short(evidence)
        yield from unmet(evidence)
        yield from aborts(evidence)
    yield keep_out(evidence)


def last_phase(evidence: RunEvidence) -> np.ndarray:
    """(runs,) number of the last phase of the scenario that a run was in, before a hold or an abort."""
    phase = evidence.phases["transition_phase"]
    in_table = (phase >= 0) & (phase < len(evidence.file.phases))
    place = phase.shape[1] - 1 - np.argmax(in_table[:, ::-1], axis=1)
    return np.where(in_table.any(axis=1), phase[np.arange(len(phase)), place], 0).astype(int)


def entered_s(evidence: RunEvidence, phase: np.ndarray) -> Numbers:
    """(runs,) when each run first began a phase (runs,) [s]."""
    began = evidence.phases["transition_phase"] == phase[:, None]
    return np.min(np.where(began, evidence.phases["transition_at_s"], np.inf), axis=1, initial=np.inf)


def _left_s(evidence: RunEvidence, phase: np.ndarray) -> Numbers:
    """(runs,) when each run left the phase (runs,) that it was in [s], the end of the run if it did not."""
    after = evidence.phases["transition_at_s"] > entered_s(evidence, phase)[:, None]
    found = np.min(np.where(after, evidence.phases["transition_at_s"], np.inf), axis=1, initial=np.inf)
    return np.minimum(found, evidence.file.duration_s)


def corridors(evidence: RunEvidence) -> Iterator[Finding]:
    """The corridor was left, one finding for each phase with one."""
    file, phase, left = evidence.file, last_phase(evidence), evidence.abort_reason == AbortReason.CORRIDOR_LEFT
    unknown = np.full(evidence.count, np.nan)
    ahead_m, aside_m = (evidence.phases.get(f"corridor_{side}_m", unknown) for side in ("ahead", "aside"))
    for row, section in enumerate(file.phases):
        here = left & (phase == row)
        if section.corridor is None or not here.any():
            continue
        width_m, angle_deg = (
            evidence.value(f"phases.{section.name}.corridor.{key}") for key in ("width_m", "half_angle_deg")
        )
        half_m = width_m + np.tan(np.radians(angle_deg)) * np.maximum(ahead_m, 0.0)

        def words(chosen: Flags, name: str = section.name, half: Numbers = half_m) -> str:
            found = f"the corridor of {name} is left at {number(median(_last(evidence.trace('range_m')), chosen))} m"
            if not np.isfinite(half[chosen]).any():
                return found
            if not (ahead_m[chosen] >= 0.0).any():
                return f"{found}, {number(-median(ahead_m, chosen))} m before its tip"
            return (
                f"{found}, {number(median(aside_m, chosen))} m from its axis by the estimate, where it is "
                f"{number(median(half, chosen))} m wide to each side"
            )

        def mend(chosen: Flags, name: str = section.name, angle: Numbers = angle_deg, width: Numbers = width_m) -> str:
            key = f"phases.{name}.corridor"
            wider = change(file, f"{key}.half_angle_deg", max(2.0 * median(angle, chosen), _LEAST_ANGLE_DEG))
            return (
                f"{wider} and {change(file, f'{key}.width_m', max(2.0 * median(width, chosen), _LEAST_WIDTH_M))}, "
                "or smaller errors on the way"
            )

        yield Finding(
            "corridor",
            f"the corridor of {section.name} is left",
            Depth.MECHANISM,
            np.where(here, _CERTAIN, 0.0),
            evidence.aborted_at_s,
            words,
            mend,
        )


def least_time_s(section: PhaseSection) -> float:
    """Least time that a phase takes by its conditions [s]."""
    until = section.until.model_dump() if section.until else {}
    return max(float(until.get(name) or 0.0) for name in ("time_s", *LASTING_KEYS))


def _way_s(evidence: RunEvidence, row: int) -> float:
    """Median time that runs which went on took in a phase [s], else the least by its conditions and its way."""
    section = evidence.file.phases[row]
    went_on = (evidence.phases["transition_phase"] == row + 1).any(axis=1)
    took = evidence.phases["duration_s"][went_on, row]
    if len(took):
        return float(np.median(took))
    return max(least_time_s(section), _approach_s(evidence, row))


def _approach_s(evidence: RunEvidence, row: int) -> float:
    """Least time of an approach at its greatest speed from the place before it [s]; 0 of other references."""
    reference = evidence.file.phases[row].reference.model_dump()
    speed, end = reference.get("max_speed_m_s"), reference.get("end_position_m")
    if reference.get("kind") != "approach" or not speed or end is None:
        return float(reference.get("duration_s") or reference.get("join_s") or 0.0)
    before = evidence.file.phases[row - 1] if row else None
    table = before.reference.model_dump() if before else {}
    start = table.get("position_m") or table.get("end_position_m") or evidence.file.initial.relative_position_m
    way = np.linalg.norm(np.subtract(start, end))
    if (before.frame if before else "hill") != evidence.file.phases[row].frame:
        # How the axes stand to each other is not known before flight: no way is shorter than the straight one inwards.
        way = abs(np.linalg.norm(start) - np.linalg.norm(end))
    return float(way) / float(speed)


def short(evidence: RunEvidence) -> Finding:
    """The run ends before the phases can, although nothing holds it up."""
    file, phase = evidence.file, last_phase(evidence)
    unfinished = (evidence.outcomes == str(Outcome.UNFINISHED)) & ~np.isfinite(evidence.aborted_at_s)
    entered = entered_s(evidence, phase)
    still = np.isclose(_left_s(evidence, phase), file.duration_s)
    expected = np.array([_way_s(evidence, row) for row in range(len(file.phases))])
    names = [each.name for each in file.phases]
    goal = names.index(file.goal.phase) if file.goal.phase in names else len(names) - 1
    to_come = np.array([expected[row : goal + 1].sum() for row in range(len(file.phases))])
    if file.phases[goal].until is None:
        to_come = to_come - expected[goal]
    needed = entered + to_come[phase]
    lacking = unfinished & still & (file.duration_s - entered < 1.5 * np.maximum(expected[phase], 1.0))
    needed = np.maximum(needed, file.duration_s * 1.05)

    def words(chosen: Flags) -> str:
        name = file.phases[int(np.median(phase[chosen]))].name
        return (
            f"the run of {number(file.duration_s)} s ends in {name}, begun at {number(median(entered, chosen))} s: "
            f"the phases take some {number(median(needed, chosen))} s"
        )

    def mend(chosen: Flags) -> str:
        return change(file, "duration_s", 1000.0 * np.ceil(1.3e-3 * median(needed, chosen)))

    return Finding(
        "short",
        "the run is shorter than the mission",
        Depth.ROOT,
        np.where(lacking, _CERTAIN, 0.0),
        entered,
        words,
        mend,
    )


def unmet(evidence: RunEvidence) -> Iterator[Finding]:
    """Conditions of a phase are never met, one finding for each phase and set of conditions."""
    file, phase = evidence.file, last_phase(evidence)
    bits = np.asarray(evidence.phases["unmet_conditions"])
    stayed_s = _left_s(evidence, phase) - entered_s(evidence, phase)
    stuck = evidence.failed & (bits > 0) & (stayed_s > 0.0)
    stuck &= (evidence.outcomes == str(Outcome.UNFINISHED)) | (evidence.abort_reason == AbortReason.TIMEOUT)
    for row, code in sorted({(int(a), int(b)) for a, b in zip(phase[stuck], bits[stuck], strict=True)}):
        here = stuck & (phase == row) & (bits == code)
        name, conditions = file.phases[row].name, Condition(code)

        def words(chosen: Flags, row: int = row, name: str = name, conditions: Condition = conditions) -> str:
            wanted = "; ".join(_wanted(evidence, row, each, chosen) for each in Condition if each & conditions)
            return f"the phase {name} does not end in {number(median(stayed_s, chosen))} s: {wanted}"

        def mend(_: Flags, row: int = row, conditions: Condition = conditions) -> str:
            keys = [
                f"phases.{file.phases[row].name}.until.{CONDITION_KEYS[each]}"
                for each in Condition
                if each & conditions
            ]
            return f"{', '.join(keys)} that the runs can meet"

        yield Finding(
            "phase",
            f"the phase {name} never ends",
            Depth.CONSEQUENCE,
            np.where(here, _CERTAIN, 0.0),
            entered_s(evidence, phase),
            words,
            mend,
        )


def _wanted(evidence: RunEvidence, row: int, condition: Condition, chosen: Flags) -> str:
    """What a condition wants, and what the runs have."""
    until = evidence.file.phases[row].until
    assert until is not None
    if condition == Condition.TIME:
        return f"time_s = {number(float(until.time_s or 0.0))} is not over"
    if condition == Condition.RANGE_SIGMA:
        least = _least(evidence.trace("nav_relative_sigma3_m") / 3.0)
        limit = number(float(until.range_sigma_m or 0.0))
        return f"range_sigma_m = {limit}, and the position's sigma is {number(median(least, chosen))} m at best"
    if condition == Condition.ARRIVAL:
        box = " x ".join(number(float(each)) for each in until.arrival_box_m or ())
        error = _last(evidence.trace("formation_error_m"))
        return f"arrival_box_m = {box}, and the error is {number(median(error, chosen))} m at the end"
    if condition == Condition.ATTITUDE_SIGMA:
        known = median(evidence.metric("target_attitude_known_fraction"), chosen)
        share = f", and it is known at all in {percent(known)} of the time" if np.isfinite(known) else ""
        return f"attitude_sigma_deg = {number(float(until.attitude_sigma_deg or 0.0))} of the target's attitude{share}"
    return "no go from the ground"


def _least(values: Numbers) -> Numbers:
    found = np.min(np.where(np.isfinite(values), values, np.inf), axis=1, initial=np.inf)
    return np.where(np.isfinite(found), found, np.nan)


def _last(values: Numbers) -> Numbers:
    known = np.isfinite(values)
    place = values.shape[1] - 1 - np.argmax(known[:, ::-1], axis=1)
    return np.where(known.any(axis=1), values[np.arange(len(values)), place], np.nan)


def aborts(evidence: RunEvidence) -> Iterator[Finding]:
    """Aborts by reason and phase, where no cause farther back is known."""
    phase, tests = last_phase(evidence), navigation_rules.tests_failed_last(evidence)
    for reason in AbortReason:
        for row, section in enumerate(evidence.file.phases):
            here = (evidence.abort_reason == reason) & (phase == row)
            if reason in (AbortReason.NONE, AbortReason.CORRIDOR_LEFT) or not here.any():
                continue

            title = f"abort in {section.name}: {reason.text}"

            def words(chosen: Flags, reason: AbortReason = reason, title: str = title) -> str:
                range_m = _last(evidence.trace("range_m"))
                return (
                    f"{title}{_by_tests(reason, tests, chosen)}, at "
                    f"{number(median(evidence.aborted_at_s, chosen))} s and {number(median(range_m, chosen))} m"
                )

            def mend(chosen: Flags, reason: AbortReason = reason, name: str = section.name) -> str:
                failed = navigation_rules.most_common(tests, chosen)
                if reason == AbortReason.CONFIDENCE_LOST and failed:
                    return "; ".join(navigation_rules.ADVICE[test] for test in failed)
                return _ENDS.get(reason, "").replace("PHASE", name)

            yield Finding(
                "abort",
                title,
                Depth.DECISION,
                np.where(here, _WEAK, 0.0),
                evidence.aborted_at_s,
                words,
                mend,
            )


def _by_tests(reason: AbortReason, tests: Flags, chosen: Flags) -> str:
    """By which health tests (runs, tests) confidence was lost in some runs; empty for other reasons."""
    failed = navigation_rules.most_common(tests, chosen) if reason == AbortReason.CONFIDENCE_LOST else []
    return f" by the test{'s' if len(failed) > 1 else ''} {' and '.join(failed)}" if failed else ""


def keep_out(evidence: RunEvidence) -> Finding:
    """The keep-out sphere is entered, and nothing farther back tells why."""
    entered = evidence.outcomes == str(Outcome.KEEP_OUT)
    radius, error = evidence.value("limits.keep_out_m"), _last(evidence.trace("nav_relative_error_m"))

    def words(chosen: Flags) -> str:
        return (
            f"the keep-out sphere of {number(median(radius, chosen))} m is entered at "
            f"{number(median(evidence.failed_at_s, chosen))} s, with an error of navigation of "
            f"{number(median(error, chosen))} m"
        )

    return Finding(
        "keep_out",
        "the keep-out sphere is entered",
        Depth.DECISION,
        np.where(entered, _WEAK, 0.0),
        evidence.failed_at_s,
        words,
        lambda _: (
            "a station farther away"
            + ("" if evidence.file.phases else " (formation.desired_position_m)")
            + ", or a passively safe relative orbit"
        ),
    )
