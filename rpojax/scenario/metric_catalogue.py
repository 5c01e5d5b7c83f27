"""Names and units of the metrics, which of them are better when greater, and their time windows; free of JAX."""

from typing import Final

import numpy as np

UNITS: Final[dict[str, str]] = {
    "formation_error_rms_m": "m",
    "nav_relative_position_error_rms_m": "m",
    "nav_servicer_position_error_rms_m": "m",
    "nav_target_position_error_rms_m": "m",
    "nees_mean": "-",
    "nees_relative_mean": "-",
    "nis_gps_mean": "-",
    "nis_box_mean": "-",
    "gps_innovation_lag1": "-",
    "box_innovation_lag1": "-",
    "sigma3_coverage": "-",
    "delta_v_m_s": "m/s",
    "min_range_m": "m",
    "detection_rate": "-",
    "visible_fraction": "-",
    "boxes_rejected": "-",
    "time_to_acquire_s": "s",
    "pointing_error_p95_deg": "deg",
    "wheel_speed_peak_fraction": "-",
    "good_boxes_rejected_fraction": "-",
    "outliers_accepted": "-",
    "look_away_peak_s": "s",
    "longest_unseen_s": "s",
    "reacquisition_peak_s": "s",
    "passive_range_m": "m",
    "error_over_sigma3_peak": "-",
}
"""Unit of every metric by name."""

LOW_IS_BAD: Final = frozenset(
    {"min_range_m", "passive_range_m", "sigma3_coverage", "detection_rate", "visible_fraction"}
)
"""Metrics of which low values are worse."""


def window_starts(ticks: int, tick_s: float) -> tuple[int, int]:
    """First tick of the late window, from 1000 s to the end, and of the last window, the final 1000 s.

    A run shorter than 3000 s has a third of its duration in place of 1000 s.
    """
    third = max(1, min(round(1000.0 / tick_s), ticks // 3))
    return min(third, ticks - 1), ticks - third


def worst_first(name: str, values: np.ndarray) -> np.ndarray:
    """Rows with a defined value of a metric in `values` (runs,), sorted from worst to best; the sort is stable."""
    defined = np.flatnonzero(np.isfinite(values))
    goodness = values[defined] if name in LOW_IS_BAD else -values[defined]
    return defined[np.argsort(goodness, kind="stable")]
