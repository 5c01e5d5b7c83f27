"""Causes before the lens: target larger than the frame or too small in it, light, missing and false boxes."""

import math
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from rpojax.analysis.failure_causes.finding import Depth, Finding, median, number, percent
from rpojax.analysis.failure_causes.present_values import at_least, at_most, change
from rpojax.analysis.failure_causes.run_evidence import Flags, Numbers, RunEvidence
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.attitude_authority import lacking_torques
from rpojax.scenario.warnings.control_authority import HALF_TURN, longest_burns_s
from rpojax.scenario.warnings.target_light import light_warnings
from rpojax.scenario.warnings.target_size import least_half_frame

_CUT: Final = 0.4
"""Share of boxes cut by the frame from which on the target is too large for it. A choice: of a cut box only the bearing
is used, and roughly."""
_MISSED: Final = 0.5
"""Share of frames without a true box from which on a detector misses too much. A choice: a fifth is nothing unusual."""
_HOPELESS: Final = 0.8
"""Share of missed frames from which on it does not help that the filter is told of them."""
_MORE, _LEAST_MORE = 2.0, 0.2
"""Missed frames of the whole time over the believed share, and their least share, from which on they count."""
_KNOWN: Final = 0.5
"""Error of direction over half the field of view up to which the target would be in it."""
_PAST: Final = 0.4
"""Share of the time that looks past such a target from which on the attitude is at fault."""
_LEAST_FRAMES: Final = 8
"""Fewest frames in ten minutes that tell of missing boxes: a search leaves the target soon. Chance misses none so."""
_FALSE: Final = 0.25
"""Share of frames with a false box from which on there are too many. A choice: five times those of `inspection`."""
_DARK: Final = 0.25
"""Share of the time without light from which on it may be too dark; `inspection_eclipse` copes with a third."""
_ROOM: Final = 1.3
"""Room around the target in a frame that holds it, and over the least size in pixels."""
_LENS, _HANDOVER = "camera.field_of_view_deg", "navigation.initial_relative_position_sigma_m"
_MISSES, _SLEWS = "navigation.miss_probability", "pointing.slew_acceleration_mrad_s2"
_NEARER, _FARTHER = 0.7, 1.5
"""Of the planned ranges: outside of these a picture too large or too small is a consequence of having drifted away."""


def findings(evidence: RunEvidence) -> Iterator[Finding]:
    """Findings of the runs; none where signs were not recorded."""
    if evidence.has_signs:
        yield frame(evidence)
        yield too_small(evidence)
        yield out_of_view(evidence)
        yield pointing(evidence)
        yield dark(evidence)
        yield misses(evidence)
        yield false_boxes(evidence)


def frame(evidence: RunEvidence) -> Finding:
    """The target outgrows the frame."""
    nearest, _ = evidence.planned_ranges_m
    planned = ~(evidence.ranges_m < _NEARER * nearest)
    cut, boxes = (np.where(planned, evidence.sign(name), 0) for name in ("cut", "good_boxes"))
    share, at_s = evidence.worst_share(cut, boxes)
    is_cut = (cut >= _CUT * boxes) & (cut > 0)
    below = np.max(np.where(is_cut, evidence.ranges_m, -np.inf), axis=1, initial=-np.inf)
    below = np.where(np.isfinite(below), below, np.nan)

    def words(chosen: Flags) -> str:
        return (
            f"the target outgrows the frame below {number(median(below, chosen))} m "
            f"({percent(median(share, chosen))} of boxes cut)"
        )

    return Finding(
        "frame",
        "the target outgrows the frame",
        Depth.ROOT,
        share / _CUT,
        at_s,
        words,
        lambda _: (
            f"{change(evidence.file, _LENS, holding_lens_deg(evidence, nearest))}, which holds it at "
            f"{number(nearest)} m"
        ),
    )


def holding_lens_deg(evidence: RunEvidence, range_m: float) -> float:
    """Field of view [deg] that holds the target at a range [m] with room around it, in steps of 5 deg from 10 on."""
    camera = evidence.file.camera
    across = _ROOM * evidence.target_m[1] * evidence.reach.high("target.scale") / max(range_m, 1e-3)
    shape = max(1.0, camera.width_px / camera.height_px)
    whole = 2.0 * math.degrees(math.atan(0.5 * across * shape))
    step = 5.0 if whole > 10.0 else 1.0
    return step * math.ceil(whole / step)


def too_small(evidence: RunEvidence) -> Finding:
    """The target is too small in the picture."""
    file, (_, farthest) = evidence.file, evidence.planned_ranges_m
    least, side_px = _least_px(evidence), _side_px(evidence)
    small = (side_px < _ROOM * least) & (evidence.ranges_m < _FARTHER * farthest)
    seen, frames = (np.where(small, evidence.sign(name), 0) for name in ("good_boxes", "in_view"))
    share, at_s = evidence.worst_share(frames - seen, frames, _LEAST_FRAMES)
    smallest = np.min(np.where(small, side_px, np.inf), axis=1, initial=np.inf)
    smallest = np.where(np.isfinite(smallest), smallest, np.nan)
    narrower = math.degrees(2.0 * math.atan(math.tan(math.radians(0.5 * file.camera.field_of_view_deg)) / 2.0))

    def words(chosen: Flags) -> str:
        return (
            f"the target is too small in the picture ({number(median(smallest, chosen))} px, boxes from "
            f"{number(least)} px on; {percent(median(share, chosen))} of frames without one)"
        )

    def mend(chosen: Flags) -> str:
        factor = 2.0 * _ROOM * least / max(median(smallest, chosen), 1e-3)
        lens = 2.0 * math.degrees(math.atan(math.tan(math.radians(0.5 * file.camera.field_of_view_deg)) / factor))
        pixels = change(file, "camera.width_px", math.ceil(factor) * file.camera.width_px)
        return f"{change(file, _LENS, min(lens, narrower))}, or {pixels} and the height with it"

    return Finding(
        "too_small", "the target is too small in the picture", Depth.ROOT, share / _MISSED, at_s, words, mend
    )


def _least_px(evidence: RunEvidence) -> float:
    """Least side of a box [px]."""
    camera = evidence.file.camera
    return float(camera.minimum_size_px if camera.model == "geometric" else evidence.file.navigation.minimum_size_px)


def _side_px(evidence: RunEvidence) -> Numbers:
    """(runs, intervals) longer side of the target's picture in the median over attitudes [px]."""
    metres = evidence.target_m[0] * evidence.value("target.scale")[:, None]
    return np.asarray(evidence.focal_px * metres / evidence.ranges_m)


def out_of_view(evidence: RunEvidence) -> Finding:
    """The camera looks past the target: a root where the lens is narrower than what is known at the hand-over."""
    share, at_s = evidence.worst_share(evidence.sign("out_of_view"), evidence.sign("looking"))
    believed = evidence.file.navigation
    half_deg = math.degrees(math.atan(least_half_frame(evidence.file, evidence.reach)))
    start_m = float(np.linalg.norm(evidence.file.initial.relative_position_m))
    sigma_deg = math.degrees(math.atan(float(np.max(believed.initial_relative_position_sigma_m)) / max(start_m, 1e-3)))
    is_narrow = sigma_deg > half_deg

    def words(chosen: Flags) -> str:
        return (
            f"the camera looks past the target in {percent(median(share, chosen))} of the worst ten minutes: half its "
            f"field of view is {number(half_deg)} deg, and the start is known to {number(sigma_deg)} deg (1 sigma)"
        )

    def mend(_: Flags) -> str:
        if not is_narrow:
            return "see why the estimate of the target went wrong before"
        lens = change(evidence.file, _LENS, 5.0 * math.ceil(1.2 * sigma_deg))
        known_m = start_m * math.tan(math.radians(half_deg))
        return f"{lens}, or a better hand-over: {at_most(evidence.file, _HANDOVER, known_m)}"

    depth = Depth.ROOT if is_narrow else Depth.CONSEQUENCE
    title = "the camera looks past the target"
    return Finding("out_of_view", title, depth, share / _MISSED, at_s, words, mend, is_loss=True)


def pointing(evidence: RunEvidence) -> Finding:
    """The camera looks past a target whose direction is known: a root where slews ask more torque than wheels have."""
    file, half = evidence.file, math.atan(least_half_frame(evidence.file, evidence.reach))
    angle = evidence.in_intervals("nav_relative_error_m") / np.maximum(evidence.ranges_m, 1e-3)
    past, looking = (np.where(angle < _KNOWN * half, evidence.sign(name), 0) for name in ("out_of_view", "looking"))
    share, at_s = evidence.worst_share(past, looking)
    torque = lacking_torques(evidence.file, evidence.reach)
    total = np.sum(np.where(past > 0, angle * past, 0.0), axis=1)
    known_deg = np.degrees(total / np.maximum(past.sum(axis=1), 1))

    def words(chosen: Flags) -> str:
        found = (
            f"the camera looks past the target in {percent(median(share, chosen))} of the worst ten minutes, although "
            f"navigation knows its direction to {number(median(known_deg, chosen))} deg"
        )
        if not torque:
            return found
        first = torque[0]
        slews = f"{first.key} = {number(evidence.reach.high(first.key))} takes {number(first.needed_n_m)} N m"
        return f"{found}: {slews} of wheel {first.wheel}, which gives {number(first.limit_n_m)}"

    def mend(_: Flags) -> str:
        if not torque:
            return f"a smaller {_SLEWS}, a longer pointing.settle_time_s, or see attitude and star tracker"
        stronger = at_least(file, f"wheels.torque_limit_n_m[{torque[0].wheel}]", torque[0].needed_n_m)
        slower = {each.key: evidence.reach.high(each.key) * each.limit_n_m / each.needed_n_m for each in torque}
        if not _leave_time(file, slower):
            return f"{stronger}; slower slews leave no time for a burn"
        return f"{stronger}; or {' and '.join(change(file, key, value) for key, value in slower.items())}"

    name, depth = ("wheels", Depth.ROOT) if torque else ("pointing", Depth.MECHANISM)
    title = "wheels give too little torque" if torque else "the attitude does not follow"
    return Finding(name, title, depth, share / _PAST, at_s, words, mend)


def _leave_time(file: ScenarioFile, slower: Mapping[str, float]) -> bool:
    """Whether half a turn and back with smaller accelerations leave time for a burn within the look-away limit."""
    if _SLEWS not in slower:
        return True
    pointing = file.pointing.model_copy(update={_SLEWS.partition(".")[2]: slower[_SLEWS]})
    turning = file.model_copy(update={"pointing": pointing})
    return bool(longest_burns_s(turning, *HALF_TURN) >= file.thruster.minimum_on_time_s)


def dark(evidence: RunEvidence) -> Finding:
    """There is no light to see the target by."""
    darkness, ticks = evidence.sign("dark"), evidence.sign("ticks")
    share = darkness.sum(axis=1) / np.maximum(ticks.sum(axis=1), 1)
    at_s = evidence.first_interval_s((darkness >= _DARK * ticks) & (darkness > 0))
    longest = evidence.interval_s * _longest(2 * darkness > ticks)

    def words(chosen: Flags) -> str:
        return (
            f"the light does not show the target in {percent(median(share, chosen))} of the time "
            f"(longest {number(median(longest, chosen))} s){_kinds_of_darkness(evidence)}"
        )

    def mend(_: Flags) -> str:
        return (
            "another plane or time (orbit.raan_deg, epoch_utc), the side of the target on which the Sun is, or a lamp"
        )

    return Finding("dark", "there is no light to see the target by", Depth.ROOT, share / _DARK, at_s, words, mend)


def _kinds_of_darkness(evidence: RunEvidence) -> str:
    """Which kind of darkness there is over an orbit, from the scenario's warnings; empty without one."""
    for line in light_warnings(evidence.file, evidence.reach):
        if "(eclipse" in line:
            return f": {line.partition('(')[2].partition(')')[0]}"
    return ""


def _longest(flags: Flags) -> Numbers:
    """Longest stretch of raised flags (runs, intervals) in each run."""
    longest = current = np.zeros(len(flags))
    for column in flags.T:
        current = np.where(column, current + 1.0, 0.0)
        longest = np.maximum(longest, current)
    return longest


def misses(evidence: RunEvidence) -> Finding:
    """The detector misses a target that is before the lens, in the light, and large enough."""
    large = ~(_side_px(evidence) < _ROOM * _least_px(evidence))
    seen, frames = (np.where(large, evidence.sign(name), 0) for name in ("good_boxes", "in_view"))
    share, at_s = evidence.worst_share(frames - seen, frames, _LEAST_FRAMES)
    whole = (frames - seen).sum(axis=1) / np.maximum(frames.sum(axis=1), 1)
    believed = evidence.file.navigation.miss_probability

    def words(chosen: Flags) -> str:
        return (
            f"the detector misses the target in {percent(median(whole, chosen))} of the frames that show it "
            f"({percent(believed)} believed)"
        )

    def mend(chosen: Flags) -> str:
        missed = median(whole, chosen)
        told = f", or {change(evidence.file, _MISSES, missed)}" if missed < _HOPELESS else ""
        better = f"a detector that finds it in {percent(1.0 - believed)} of them"
        return f"{better}{_of_error_model(evidence, 'camera.miss_probability', believed)}{told}"

    strength = np.minimum(share / _MISSED, whole / max(_MORE * believed, _LEAST_MORE))
    return Finding("misses", "boxes are missing", Depth.ROOT, strength, at_s, words, mend)


def false_boxes(evidence: RunEvidence) -> Finding:
    """Boxes of something else, in place of those of the target."""
    share, at_s = evidence.worst_share(evidence.sign("false_boxes"), evidence.sign("looking"))
    names = ("false_accepted", "good_boxes", "good_rejected", "in_view", "out_of_view", "looking")
    accepted, good, rejected, seen, past, looking = (evidence.sign(name).sum(axis=1).astype(float) for name in names)

    def words(chosen: Flags) -> str:
        left = f"{percent(median(good / seen, chosen))} of those that show the target have a true one"
        through = f"the gate rejected {percent(median(rejected / good, chosen))} of these and let "
        through += f"{median(accepted, chosen):.0f} false ones through in a run"
        lost = median(past / looking, chosen)
        return (
            f"{percent(median(share, chosen))} of frames have a false box in the worst ten minutes; {left}, {through}"
            + (f", and the camera looked past the target in {percent(lost)} of all frames" if lost > _PAST else "")
        )

    def mend(_: Flags) -> str:
        fewer = f"a detector with less than {percent(_FALSE)} of them"
        score = evidence.file.camera.model == "rendered"
        return (
            f"{fewer}{_of_error_model(evidence, 'camera.outlier_probability', _FALSE)}: one that is trained further"
            + (", or a higher camera.score_threshold" if score else "")
        )

    return Finding("false_boxes", "boxes are false", Depth.ROOT, share / _FALSE, at_s, words, mend)


def _of_error_model(evidence: RunEvidence, key: str, most: float) -> str:
    """The key of a detector's error model and what it may be, in brackets; empty where it is so, or with images."""
    declared = evidence.file.camera.model == "geometric" and evidence.reach.high(key) > most
    return f" ({at_most(evidence.file, key, most)})" if declared else ""
