"""Names, meanings and number formats that readers see."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from rpojax.scenario.metric_catalogue import LOW_IS_BAD, UNITS


@dataclass(frozen=True)
class MetricLabel:
    """Title, meaning and unit of one metric, and whether a low value is the bad one."""

    title: str
    meaning: str
    unit: str
    low_is_bad: bool = False

    @property
    def tail_statistics(self) -> tuple[str, str, str, str]:
        """Names in report.json of what one run in 20, in 100 is beyond, its bound, and the worst, on the bad side."""
        return ("p5", "p1", "p1_lower_95", "min") if self.low_is_bad else ("p95", "p99", "p99_upper_95", "max")


@dataclass(frozen=True)
class ChannelLabel:
    """Title and unit of one trace over time, and how to draw it."""

    name: str
    title: str
    unit: str
    logarithmic: bool = False
    low_is_bad: bool = False


_FINAL_PHASE = "over the last 1000 s or third of the run"
_SETTLED_PHASE = "from 1000 s (or a third of a shorter run) to the end"

_TITLES_AND_MEANINGS: dict[str, tuple[str, str]] = {
    "formation_error_rms_m": (
        "Formation error",
        f"RMS distance of the true relative position from the desired one, {_FINAL_PHASE}; "
        "estimation error is part of it.",
    ),
    "nav_relative_position_error_rms_m": (
        "Relative navigation error",
        f"RMS 3-D error of the estimated position of the servicer from the target, {_SETTLED_PHASE}.",
    ),
    "nav_servicer_position_error_rms_m": (
        "Servicer navigation error",
        f"RMS 3-D error of the servicer's estimated absolute position, {_SETTLED_PHASE}.",
    ),
    "nav_target_position_error_rms_m": (
        "Target navigation error",
        f"RMS 3-D error of the target's estimated absolute position, {_SETTLED_PHASE}.",
    ),
    "nees_mean": (
        "NEES, both spacecraft",
        "Mean normalised estimation error squared of the 12 position and velocity components; 12 is consistent.",
    ),
    "nees_relative_mean": (
        "NEES, relative",
        "The same for the 6 components of the relative state; 6 is consistent.",
    ),
    "nis_gps_mean": (
        "NIS, GPS",
        "Mean normalised innovation squared of the three GPS coordinates; 3 is consistent.",
    ),
    "nis_box_mean": (
        "NIS, box",
        "The same for bearing and size of the boxes that were used and whole; 3 is consistent.",
    ),
    "gps_innovation_lag1": (
        "Whiteness, GPS",
        "Correlation of normalised GPS innovations with those one tick later; 0 for a consistent filter.",
    ),
    "box_innovation_lag1": (
        "Whiteness, box",
        "The same for the boxes that were used in two ticks on end.",
    ),
    "sigma3_coverage": (
        "3-sigma coverage",
        "Share of seconds and Hill axes in which the relative position error is inside 3 sigma; "
        "a normal error gives 0.9973.",
    ),
    "error_over_sigma3_peak": (
        "Worst error over 3 sigma",
        "Largest relative position error over its own 3-sigma bound, any axis and time.",
    ),
    "delta_v_m_s": ("Delta-v", "Velocity change that the thruster applied over the whole run."),
    "min_range_m": ("Minimum range", "Smallest true distance of the two spacecraft."),
    "passive_range_m": (
        "Passive range",
        "Smallest distance within one orbit of free drift, had thrust stopped at any time.",
    ),
    "pointing_error_p95_deg": (
        "Pointing error, p95",
        "95th percentile of the angle from boresight to target while the camera is meant to be on it and settled.",
    ),
    "wheel_speed_peak_fraction": ("Peak wheel speed", "Highest reaction wheel speed as a fraction of its limit."),
    "look_away_peak_s": (
        "Look-away in a burn period",
        "Time turned away from the target (turn, burn, turn back), summed over one burn period; the largest such sum.",
    ),
    "reacquisition_peak_s": (
        "Longest reacquisition",
        "Longest wait from the target coming into the light to the next accepted box.",
    ),
    "longest_unseen_s": ("Longest time unseen", "Longest stretch without an accepted box, look-aways included."),
    "time_to_acquire_s": ("Time to acquire", "Time until the first accepted box."),
    "visible_fraction": ("Tracked fraction", "Share of all frames with an accepted box."),
    "detection_rate": (
        "Detection rate",
        "Boxes per frame whose light allows to see the target, frames of look-aways included.",
    ),
    "boxes_rejected": ("Boxes rejected", "Number of boxes that the filter's gate refused."),
    "good_boxes_rejected_fraction": ("Good boxes rejected", "Share of true boxes that the gate refused."),
    "outliers_accepted": ("Outliers accepted", "Number of false boxes that passed the gate."),
}
"""Title and meaning of every metric, in the order in which a reader wants them."""

CHANNEL_LABELS = (
    ChannelLabel("formation_error_m", "Formation error", "m", logarithmic=True),
    ChannelLabel("nav_relative_error_m", "Relative navigation error and its 3 sigma", "m", logarithmic=True),
    ChannelLabel("range_m", "Range between the spacecraft", "m", low_is_bad=True),
    ChannelLabel("delta_v_m_s", "Delta-v applied", "m/s"),
    ChannelLabel("nees", "NEES of 12 position and velocity components", "", logarithmic=True),
)


def metric_label(name: str) -> MetricLabel:
    """How to show the metric `name`; one that has no text here is shown by its own name."""
    title, meaning = _TITLES_AND_MEANINGS.get(name, (name.replace("_", " "), ""))
    unit = UNITS.get(name, "-")
    return MetricLabel(title, meaning, "" if unit == "-" else unit, name in LOW_IS_BAD)


def in_display_order(names: Iterable[str]) -> list[str]:
    """Names of metrics in the order in which a reader wants them: formation, navigation, consistency, ..., boxes."""
    places = {name: place for place, name in enumerate(_TITLES_AND_MEANINGS)}
    return sorted(names, key=lambda name: (places.get(name, len(places)), name))


def with_unit(text: str, unit: str) -> str:
    """A number's text and its unit, which is empty for a pure number."""
    return f"{text} {unit}" if unit else text


def format_number(value: float | None, digits: int = 4) -> str:
    """`value` with `digits` significant digits, whole numbers without decimals, and a dash for None or NaN."""
    if value is None or not math.isfinite(value):
        return "\N{EN DASH}"
    if value == 0.0 or (float(value).is_integer() and abs(value) < 1e6):
        return f"{value:.0f}"
    magnitude = math.floor(math.log10(abs(value)))
    if magnitude < -6 or magnitude > 6:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(0, digits - 1 - magnitude)}f}"


def format_p_value(p: float | None) -> str:
    """A p-value with two significant digits, and a dash for None."""
    return format_number(None) if p is None else f"{p:.2g}"
