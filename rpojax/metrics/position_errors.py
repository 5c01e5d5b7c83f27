"""Metrics of position errors: of the formation, and of navigation."""

from types import ModuleType
from typing import Final

from rpojax.metrics.metric_definition import Metric, Quantity

_LAST_WINDOW = "over the last 1000 s or third of the run"
_LATE_WINDOW = "from 1000 s (or a third of a shorter run) to the end"

_LEAST_SQUARED_RANGE = 1e-12
"""Keeps the direction to the target defined at no distance [m^2]."""


def _along(xp: ModuleType, error: Quantity, rho: Quantity) -> Quantity:
    """Component of an error along the line of sight."""
    return xp.sum(error * rho, axis=-1) / xp.sqrt(xp.maximum(xp.sum(rho * rho, axis=-1), _LEAST_SQUARED_RANGE))


METRICS: Final = (
    Metric(
        "formation_error_rms_m",
        "m",
        title="Formation error",
        meaning=f"RMS distance of the true relative position from the desired one, {_LAST_WINDOW}; "
        "estimation error is part of it.",
        inputs=("rho_H", "desired_position_H"),
        value=lambda _, rho, desired: rho - desired,
        reduction="rms",
        window="last",
        has_derivative=True,
    ),
    Metric(
        "nav_relative_position_error_rms_m",
        "m",
        title="Relative navigation error",
        meaning=f"RMS 3-D error of the estimated position of the servicer from the target, {_LATE_WINDOW}.",
        inputs=("relative_error_H",),
        reduction="rms",
        window="late",
        has_derivative=True,
    ),
    Metric(
        "nav_range_error_rms_m",
        "m",
        title="Range error",
        meaning=f"RMS error of the estimated relative position along the line of sight, {_LATE_WINDOW}.",
        inputs=("relative_error_H", "rho_H"),
        value=_along,
        reduction="rms",
        window="late",
        has_derivative=True,
    ),
    Metric(
        "nav_servicer_position_error_rms_m",
        "m",
        title="Servicer navigation error",
        meaning=f"RMS 3-D error of the servicer's estimated absolute position, {_LATE_WINDOW}.",
        inputs=("servicer_error_H",),
        reduction="rms",
        window="late",
        has_derivative=True,
    ),
    Metric(
        "nav_target_position_error_rms_m",
        "m",
        title="Target navigation error",
        meaning=f"RMS 3-D error of the target's estimated absolute position, {_LATE_WINDOW}.",
        inputs=("target_error_H",),
        reduction="rms",
        window="late",
        has_derivative=True,
    ),
)
"""Errors count at all ticks of the window, whether the target is visible or not."""
