"""Time windows of metrics: their own, and those of requirements, whose metrics are named `METRIC@WINDOW`."""

import re
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from rpojax.metrics.metric_definition import Metric, Window
from rpojax.time_scales import TIME_ROUNDING_S

_PHASE: Final = re.compile(r"([a-z][a-z0-9_]*)(?:\.(begin|end))?")
_TIMES: Final = re.compile(r"([0-9.e+-]+?)-([0-9.e+]+|end)")

DURATION: Final = Metric(
    "duration_s", "s", title="Duration", meaning="Time that a run, while it lasts, is in the window of a requirement."
)
EVENT_TIME: Final = Metric(
    "event_time_s", "s", title="Time", meaning="Time since the start of the event that a requirement names."
)
WINDOW_METRICS: Final = {metric.name: metric for metric in (DURATION, EVENT_TIME)}
"""What is stored of a window itself, by name."""


@dataclass(frozen=True)
class MetricWindow:
    """Ticks of a run that count for a requirement: of a phase, of one end of a phase, or between two times.

    Attributes:
        phase: name of a phase
        at: that end of the phase alone: its first tick, or the last one before another phase, if not a built-in one
        from_s: first time [s], by default the start
        to_s: last time [s], by default the end
    """

    phase: str | None = None
    at: Literal["begin", "end"] | None = None
    from_s: float | None = None
    to_s: float | None = None

    @property
    def suffix(self) -> str:
        """What follows the metric's name, empty for the whole run."""
        if self.phase is not None:
            return f"@{self.phase}" + ("" if self.at is None else f".{self.at}")
        if self.from_s is None and self.to_s is None:
            return ""
        end = "end" if self.to_s is None else f"{self.to_s:.15g}"
        return f"@{self.from_s or 0.0:.15g}-{end}"

    @property
    def presence_name(self) -> str:
        """Name under which it is stored how long a run was in the phase, or when its event was."""
        return (DURATION if self.at is None else EVENT_TIME).name + self.suffix

    def between_times(self, count: int, tick_s: float) -> NDArray[np.bool_]:
        """Flags (ticks,) of `count` ticks of `tick_s` [s] that are between the two times, both included."""
        time_s = np.arange(count) * tick_s
        begin = -np.inf if self.from_s is None else self.from_s - TIME_ROUNDING_S
        end = np.inf if self.to_s is None else self.to_s + TIME_ROUNDING_S
        return (time_s >= begin) & (time_s <= end)

    def within(self, in_phase: NDArray[np.bool_], in_table: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Flags (runs, ticks) of the window from those of its phase and of all phases but the built-in ones."""
        if self.at is None:
            return in_phase
        event = in_phase.copy()
        if self.at == "end":
            event[:, :-1] &= ~in_phase[:, 1:] & in_table[:, 1:]
            event[:, -1] = False
            event = event[:, ::-1]
        flags, rows = np.zeros_like(event), np.flatnonzero(event.any(axis=1))
        flags[rows, event[rows].argmax(axis=1)] = True
        return flags[:, ::-1] if self.at == "end" else flags


def split_name(name: str) -> tuple[str, str]:
    """Metric and window, empty for the whole run, of a name such as `min_range_m@approach`."""
    metric, _, window = name.partition("@")
    return metric, window


def window_in_words(window: str) -> str | None:
    """A window as a text that follows a title, such as `in approach`; None if it is none."""
    if match := _PHASE.fullmatch(window):
        return f"in {match[1]}" if match[2] is None else f"at the {match[2]} of {match[1]}"
    if match := _TIMES.fullmatch(window):
        return f"from {match[1]} s to the end" if match[2] == "end" else f"from {match[1]} to {match[2]} s"
    return None


def first_tick(window: Window, ticks: int, tick_s: float) -> int:
    """First tick of a window of a run of `ticks`: `late` is from 1000 s to the end, `last` the final 1000 s.

    A run shorter than 3000 s has a third of its duration in place of 1000 s.
    """
    third = max(1, min(round(1000.0 / tick_s), ticks // 3))
    match window:
        case "all":
            return 0
        case "late":
            return min(third, ticks - 1)
        case "last":
            return ticks - third
