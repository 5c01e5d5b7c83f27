"""Metrics of the estimated attitude and rate of the target."""

import math
from typing import Final

from rpojax.metrics.metric_definition import Metric, WeightedValue

_WINDOW = "while the filter knows the attitude, from 1000 s (or a third of a shorter run) to the end"


def _rms_error(name: str, unit: str, title: str, meaning: str, error: str) -> Metric:
    return Metric(
        name,
        unit,
        title=title,
        meaning=f"RMS {meaning} {_WINDOW}.",
        inputs=(error, "target_attitude_known"),
        value=lambda xp, each, known: WeightedValue(xp.where(known[..., None], each, 0.0), known),
        reduction="rms",
        window="late",
        has_derivative=True,
        needs="landmarks",
    )


METRICS: Final = (
    _rms_error(
        "target_attitude_error_deg",
        "deg",
        "Attitude error of the target",
        "angle between the estimated and the true attitude of the target",
        "target_attitude_error_T_deg",
    ),
    _rms_error(
        "docking_axis_error_deg",
        "deg",
        "Error of the docking axis",
        "angle between the estimated and the true axis of the docking port, undefined of landmarks without one,",
        "docking_axis_error_T_deg",
    ),
    _rms_error(
        "target_rate_error_deg_s",
        "deg/s",
        "Rate error of the target",
        "error of the estimated rate of the target",
        "target_rate_error_T_deg_s",
    ),
    Metric(
        "nees_pose_mean",
        "-",
        title="NEES, attitude of the target",
        meaning="Mean normalised estimation error squared of attitude and rate of the target, 6 components, "
        f"{_WINDOW}; 6 is consistent.",
        inputs=("nees_pose", "target_attitude_known"),
        value=lambda xp, nees, known: WeightedValue(xp.where(known, nees, 0.0), known),
        reduction="mean",
        window="late",
        has_derivative=True,
        degrees_of_freedom=6,
        needs="landmarks",
    ),
    Metric(
        "pose_surprise",
        "-",
        title="Pose surprise",
        meaning="Negative log likelihood of the true attitude and rate of the target under the estimate, per "
        f"component, {_WINDOW}.",
        inputs=("nees_pose", "pose_log_determinant", "target_attitude_known"),
        value=lambda xp, nees, log_determinant, known: WeightedValue(
            xp.where(known, 0.5 * ((nees + log_determinant) / 6.0 + math.log(2.0 * math.pi)), 0.0), known
        ),
        reduction="mean",
        window="late",
        has_derivative=True,
        source="simulation",
        needs="landmarks",
    ),
    Metric(
        "target_attitude_known_fraction",
        "-",
        title="Attitude of the target known",
        meaning="Share of the time from 1000 s (or a third of a shorter run) on in which the filter knows the attitude "
        "of the target.",
        inputs=("target_attitude_known",),
        reduction="mean",
        window="late",
        low_is_bad=True,
        needs="landmarks",
    ),
)
"""Metrics of scenarios whose camera finds landmarks."""
