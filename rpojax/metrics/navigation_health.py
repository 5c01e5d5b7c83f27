"""Metrics of the health tests on board: confidence, false alarms and missed detections."""

from types import ModuleType
from typing import Final

from rpojax.metrics import record_statistics
from rpojax.metrics.metric_definition import Metric, Quantity, WeightedValue

GOOD_NEES: Final = 18.0
"""Relative NEES, 6 if consistent, below which a loss of confidence is a false alarm."""
BAD_NEES: Final = 150.0
"""Relative NEES, 6 if consistent, above which confidence is a missed detection."""
BAD_ERROR: Final = 0.5
"""Relative position error over the range above which it is one, too."""


def _false_alarm(xp: ModuleType, confident: Quantity, nees: Quantity) -> WeightedValue:
    return WeightedValue(xp.where(confident, 0.0, 1.0), nees < GOOD_NEES)


def _missed(xp: ModuleType, confident: Quantity, nees: Quantity, error: Quantity, distance: Quantity) -> WeightedValue:
    wrong = xp.sum(error * error, axis=-1) > (BAD_ERROR * distance) ** 2
    return WeightedValue(xp.where(confident, 1.0, 0.0), (nees > BAD_NEES) | wrong)


METRICS: Final = (
    Metric(
        "confident_fraction",
        "-",
        title="Time with confidence",
        meaning="Fraction of time in which the flight software is confident in its navigation.",
        inputs=("nav_confident",),
        reduction="mean",
        low_is_bad=True,
    ),
    Metric(
        "confidence_withdrawn_s",
        "s",
        title="Confidence withdrawn",
        meaning="Time at which the flight software first lost confidence in its navigation.",
        of_events=True,
        inputs=("nav_confident",),
        value=lambda xp, confident: ~confident,
        reduction=record_statistics.time_to_first,
    ),
    Metric(
        "health_false_alarm_fraction",
        "-",
        title="False alarms",
        meaning="Fraction of the time with a relative NEES below 18 (6 is consistent) in which the flight "
        "software is not confident in its navigation.",
        of_events=True,
        inputs=("nav_confident", "nees_relative"),
        value=_false_alarm,
        reduction=record_statistics.conditional_mean,
    ),
    Metric(
        "health_missed_fraction",
        "-",
        title="Missed detections",
        meaning="Fraction of the time with a relative NEES above 150 (6 is consistent), or a relative position error "
        "of more than half the range, in which the flight software is confident in its navigation.",
        of_events=True,
        inputs=("nav_confident", "nees_relative", "relative_error_H", "range_m"),
        value=_missed,
        reduction=record_statistics.conditional_mean,
    ),
)
