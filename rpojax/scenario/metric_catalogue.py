"""Names, units and bad sides of the metrics; free of jax, so that a scenario's requirements are checked without it."""

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
"""Name -> unit of every metric."""

LOW_IS_BAD: Final = frozenset(
    {"min_range_m", "passive_range_m", "sigma3_coverage", "detection_rate", "visible_fraction"}
)
"""Metrics whose low values are the bad ones."""


def window_starts(ticks: int, tick_s: float) -> tuple[int, int]:
    """First tick of the late part of a run, and of its last one: from 1000 s on, and 1000 s before the end.

    Of a run shorter than 3000 s it is a third instead.
    """
    third = max(1, min(round(1000.0 / tick_s), ticks // 3))
    return min(third, ticks - 1), ticks - third


def worst_first(name: str, values: np.ndarray) -> np.ndarray:
    """Rows in which a metric's `values` (runs,) are defined, the worst first; of equals, the first ones."""
    defined = np.flatnonzero(np.isfinite(values))
    goodness = values[defined] if name in LOW_IS_BAD else -values[defined]
    return defined[np.argsort(goodness, kind="stable")]
