"""Titles, meanings and units of metrics and channels, as readers see them."""

from collections.abc import Iterable
from dataclasses import dataclass

from rpojax.scenario.metric_catalogue import LOW_IS_BAD, UNITS


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
        "Mean normalised estimation error squared of the 6 components of the relative state; 6 is consistent.",
    ),
    "nis_gps_mean": (
        "NIS, GPS",
        "Mean normalised innovation squared of the three GPS coordinates; 3 is consistent.",
    ),
    "nis_box_mean": (
        "NIS, box",
        "Mean normalised innovation squared of bearing and size of the accepted, untruncated boxes; 3 is consistent.",
    ),
    "gps_innovation_lag1": (
        "Whiteness, GPS",
        "Correlation of normalised GPS innovations one tick apart; 0 for a consistent filter.",
    ),
    "box_innovation_lag1": (
        "Whiteness, box",
        "Correlation of normalised box innovations one tick apart; 0 for a consistent filter.",
    ),
    "sigma3_coverage": (
        "3-sigma coverage",
        "Fraction of seconds and Hill axes in which the relative position error is inside 3 sigma; "
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
        "Smallest distance within one orbit of free drift after a loss of thrust at any time.",
    ),
    "pointing_error_p95_deg": (
        "Pointing error, p95",
        "95th percentile of the angle from boresight to target while target pointing is commanded and settled.",
    ),
    "wheel_speed_peak_fraction": ("Peak wheel speed", "Highest reaction wheel speed as a fraction of its limit."),
    "look_away_peak_s": (
        "Look-away in a burn period",
        "Longest total time turned away from the target (turn, burn, turn back) in one burn period.",
    ),
    "reacquisition_peak_s": (
        "Longest reacquisition",
        "Longest time from the target's exit from shadow to the next accepted box.",
    ),
    "longest_unseen_s": ("Longest time unseen", "Longest time without an accepted box, look-aways included."),
    "time_to_acquire_s": ("Time to acquire", "Time until the first accepted box."),
    "visible_fraction": ("Tracked fraction", "Fraction of all frames with an accepted box."),
    "detection_rate": (
        "Detection rate",
        "Boxes per frame in which the light allows the target to be seen, look-aways included.",
    ),
    "boxes_rejected": ("Boxes rejected", "Number of boxes that the filter's gate rejected."),
    "good_boxes_rejected_fraction": ("Good boxes rejected", "Fraction of true boxes that the gate rejected."),
    "outliers_accepted": ("Outliers accepted", "Number of false boxes that passed the gate."),
}
"""Title and meaning of every metric, in display order."""
CHANNEL_LABELS = (
    ChannelLabel("formation_error_m", "Formation error", "m", logarithmic=True),
    ChannelLabel("nav_relative_error_m", "Relative navigation error and its 3 sigma", "m", logarithmic=True),
    ChannelLabel("range_m", "Range between the spacecraft", "m", low_is_bad=True),
    ChannelLabel("delta_v_m_s", "Delta-v applied", "m/s"),
    ChannelLabel("nees", "NEES of 12 position and velocity components", "", logarithmic=True),
)


def metric_label(name: str) -> MetricLabel:
    """Label of the metric `name`; a metric without a text here is shown by its name."""
    title, meaning = _TITLES_AND_MEANINGS.get(name, (name.replace("_", " "), ""))
    unit = UNITS.get(name, "-")
    return MetricLabel(title, meaning, "" if unit == "-" else unit, name in LOW_IS_BAD)


def in_display_order(names: Iterable[str]) -> list[str]:
    """Names of metrics in display order: formation, navigation, consistency, ..., boxes; unknown ones last."""
    places = {name: place for place, name in enumerate(_TITLES_AND_MEANINGS)}
    return sorted(names, key=lambda name: (places.get(name, len(places)), name))
