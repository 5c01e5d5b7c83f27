"""Titles, meanings and units of metrics and channels, and numbers as text, as readers see them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.metrics.metric_catalogue import METRICS, find


@dataclass(frozen=True)
class MetricLabel:
    """Title, meaning and unit of one metric, and whether low values are bad."""

    title: str
    meaning: str
    unit: str
    low_is_bad: bool = False

    @property
    def tail_statistics(self) -> tuple[str, str, str, str]:
        """Names in report.json of the bad tail: 5 % quantile, 1 % quantile, its confidence bound, worst value."""
        return ("p5", "p1", "p1_lower_95", "min") if self.low_is_bad else ("p95", "p99", "p99_upper_95", "max")


@dataclass(frozen=True)
class ChannelLabel:
    """Title and unit of one channel over time, and how to draw it."""

    name: str
    title: str
    unit: str
    logarithmic: bool = False
    low_is_bad: bool = False


CHANNEL_LABELS = (
    ChannelLabel("formation_error_m", "Formation error", "m", logarithmic=True),
    ChannelLabel("nav_relative_error_m", "Relative navigation error and its 3 sigma", "m", logarithmic=True),
    ChannelLabel("range_m", "Range between the spacecraft", "m", low_is_bad=True),
    ChannelLabel("delta_v_m_s", "Delta-v applied", "m/s"),
    ChannelLabel("nees", "NEES of 12 position and velocity components", "", logarithmic=True),
)

FURTHER_CHANNEL_LABELS = (
    ChannelLabel("nav_servicer_error_m", "Navigation error of the servicer", "m", logarithmic=True),
    ChannelLabel("nav_target_error_m", "Navigation error of the target", "m", logarithmic=True),
    ChannelLabel("nees_relative", "NEES of the 6 relative components", "", logarithmic=True),
    ChannelLabel("wheel_speed_fraction", "Speed of the fastest wheel over its limit", ""),
)
"""Channels that are drawn where a requirement limits them."""

LOOK_AWAY_MODES = (Mode.TURN, Mode.BURN, Mode.TURN_BACK)
"""Modes in which the camera is turned away for a burn."""


def heading(label: MetricLabel | ChannelLabel) -> str:
    """Title with the unit in brackets, if there is one."""
    return f"{label.title} [{label.unit}]" if label.unit else label.title


def metric_label(name: str) -> MetricLabel:
    """Label of the metric `name`; an unknown metric is shown by its name."""
    metric = find(name)
    if metric is None:
        return MetricLabel(name.replace("_", " "), meaning="", unit="")
    return MetricLabel(metric.title, metric.meaning, "" if metric.unit == "-" else metric.unit, metric.low_is_bad)


def of_all_servicers(names: Iterable[str]) -> list[str]:
    """Those of `names` that are not of one servicer of a team, in their order."""
    return [name for name in names if "/" not in name]


def in_display_order(names: Iterable[str]) -> list[str]:
    """Names of metrics in display order: formation, navigation, consistency, ..., boxes; unknown ones last."""
    places = {name: place for place, name in enumerate(METRICS)}
    return sorted(names, key=lambda name: (places.get(name, len(places)), name))


def with_unit(text: str, unit: str) -> str:
    """Text of a number followed by its unit, which is empty for a pure number."""
    return f"{text} {unit}" if unit else text


def format_number(value: float | None, digits: int = 4) -> str:
    """`value` with `digits` significant digits, integers without decimals, a dash for None or NaN."""
    if value is None or not math.isfinite(value):
        return "\N{EN DASH}"
    if value == 0.0 or (float(value).is_integer() and abs(value) < 1e6):
        return f"{value:.0f}"
    magnitude = math.floor(math.log10(abs(value)))
    if magnitude < -6 or magnitude > 6:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(0, digits - 1 - magnitude)}f}"


def format_interval(ends: Sequence[float | None] | None) -> str:
    """Both ends of an interval, a dash for None."""
    return format_number(None) if ends is None else f"{format_number(ends[0])} to {format_number(ends[1])}"


def format_percent_interval(low: float, high: float) -> str:
    """Interval of a probability in percent, with two significant digits."""
    ends = (100.0 * end for end in (low, high))
    return " to ".join("100" if end >= 99.5 else f"{end:.2g}" for end in ends) + " %"


def format_p_value(p: float | None) -> str:
    """P-value with two significant digits, a dash for None."""
    return format_number(None) if p is None else f"{p:.2g}"
