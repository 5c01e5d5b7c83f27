"""Timeline of one run: phases, pointing modes, light and boxes, and flags, as intervals of time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.report.campaign_results import CampaignResults

_MODES: Final = {
    Mode.LOOK: ("pointing at the target", "look"),
    Mode.TURN: ("turn for a burn", "turn"),
    Mode.BURN: ("burn", "burn"),
    Mode.TURN_BACK: ("turn back", "turn"),
    Mode.SEARCH: ("search", "search"),
}
MODE_WORDS: Final = {int(mode): words for mode, (words, _) in _MODES.items()}
"""Pointing mode in words by its code in a history."""
_PHASE_CLASSES: Final = 6
_MARKS: Final = 7
_MIN_SHARE: Final = 1.0 / 800.0
"""Shorter intervals are drawn so wide."""


class Interval(NamedTuple):
    """Part of a row of the timeline: begin and width in shares of the duration, its text, and its class."""

    begin: float
    width: float
    text: str
    css_class: str


@dataclass(frozen=True)
class TimelineRow:
    """A row of the timeline: its title, its intervals, and whether their texts fit inside."""

    title: str
    intervals: Sequence[Interval]
    labelled: bool = False


def timeline(
    campaign: CampaignResults, run_id: int, history: Mapping[str, np.ndarray], duration_s: float
) -> list[TimelineRow]:
    """Rows of the run's timeline, from top to bottom; channels that the history lacks have none."""
    time, frozen = history["time_s"], _frozen_at(campaign, run_id, duration_s)
    rows = []
    if "phase" in history and campaign.phase_names:
        names = [(name, f"phase-{index % _PHASE_CLASSES}") for index, name in enumerate(campaign.phase_names)]
        names[-2:] = [(campaign.phase_names[-2], "hold"), (campaign.phase_names[-1], "abort")]
        classes = dict(enumerate(names))
        rows.append(TimelineRow("Phase", _intervals(time, history["phase"], classes, duration_s, frozen), True))
    if "mode" in history:
        modes = {int(mode): value for mode, value in _MODES.items()}
        rows.append(TimelineRow("Pointing", _intervals(time, history["mode"], modes, duration_s, frozen)))
    flags = (
        ("Light", "observable", "the target is lit as the camera needs", "light"),
        ("Box accepted", "box_accepted", "the filter used a box", "box"),
        ("Confident", "nav_confident", "the flight software is confident in its navigation", "confident"),
    )
    for title, name, text, css_class in flags:
        if name in history:
            classes = {1: (text, css_class)}
            found = _intervals(time, _closed(history[name]).astype(int), classes, duration_s, frozen)
            rows.append(TimelineRow(title, found))
    rows.extend(_flag_rows(campaign, run_id, duration_s))
    return rows


def events(campaign: CampaignResults, run_id: int) -> list[tuple[float, str]]:
    """Time [s] and text of the flags of a run and of its end, if it failed, in order of time."""
    found = []
    for event in campaign.events:
        if event.run_id != run_id:
            continue
        found.append((float(event.raised_at_s), f"flag raised: {event.outcome}"))
        if event.cleared_at_s is not None and np.isfinite(event.cleared_at_s):
            found.append((float(event.cleared_at_s), f"flag cleared: {event.outcome}"))
    for row in np.flatnonzero(campaign.run_ids == run_id):
        if campaign.failure_reason[row]:
            found.append((float(campaign.failed_at_s[row]), f"failed: {campaign.failure_reason[row]}"))
    return sorted(found)


def phase_events(history: Mapping[str, np.ndarray], phase_names: Sequence[str]) -> list[tuple[float, str]]:
    """Time [s] at which each phase began, and its name; empty without phases."""
    if "phase" not in history or not phase_names:
        return []
    phase = history["phase"].astype(int)
    begins = np.flatnonzero(np.diff(phase, prepend=-1) != 0)
    return [(float(history["time_s"][tick]), f"phase {phase_names[phase[tick]]}") for tick in begins]


def _frozen_at(campaign: CampaignResults, run_id: int, duration_s: float) -> float:
    for row in np.flatnonzero(campaign.run_ids == run_id):
        if not campaign.reached_end[row] and np.isfinite(campaign.failed_at_s[row]):
            return float(campaign.failed_at_s[row])
    return duration_s


def _closed(flags: np.ndarray, gap: int = 5) -> np.ndarray:
    """Flags with gaps of less than `gap` ticks closed, so that single missed boxes do not make stripes."""
    ones = np.flatnonzero(flags)
    closed = flags.copy()
    for before, after in pairwise(ones):
        if 1 < after - before <= gap:
            closed[before:after] = True
    return closed


def _intervals(
    time_s: np.ndarray, codes: np.ndarray, classes: Mapping[int, tuple[str, str]], duration_s: float, frozen_s: float
) -> list[Interval]:
    """Intervals of equal codes that have a class, up to the time at which the run was frozen."""
    starts = np.flatnonzero(np.diff(codes.astype(int), prepend=codes[0] - 1) != 0)
    ends = [*time_s[starts[1:]], time_s[-1]]
    found = []
    for start, end in zip(starts, ends, strict=True):
        begin, until = float(time_s[start]), min(float(end), frozen_s)
        if int(codes[start]) not in classes or until < begin:
            continue
        text, css_class = classes[int(codes[start])]
        width = max((until - begin) / duration_s, _MIN_SHARE)
        found.append(Interval(begin / duration_s, width, f"{text}, {begin:.0f} to {until:.0f} s", css_class))
    return found


def _flag_rows(campaign: CampaignResults, run_id: int, duration_s: float) -> list[TimelineRow]:
    rows: dict[str, list[Interval]] = {}
    for event in campaign.events:
        if event.run_id != run_id:
            continue
        cleared = event.cleared_at_s
        until = duration_s if cleared is None or not np.isfinite(cleared) else float(cleared)
        begin = float(event.raised_at_s)
        text = f"{event.outcome}, {begin:.0f} to {until:.0f} s"
        width = max((until - begin) / duration_s, _MIN_SHARE)
        rows.setdefault(str(event.outcome), []).append(Interval(begin / duration_s, width, text, "abort"))
    return [TimelineRow(f"Flag: {name}", intervals) for name, intervals in rows.items()]


def time_marks(duration_s: float) -> list[dict[str, Any]]:
    """Marks below the timeline: place in shares of the duration, and text."""
    sizes = (factor * 10.0**power for power in range(1, 9) for factor in (1, 2, 5))
    step = next(size for size in sizes if duration_s / size <= _MARKS)
    return [{"at": at / duration_s, "text": f"{at:.0f} s"} for at in np.arange(0.0, duration_s + 1e-6, step)]
