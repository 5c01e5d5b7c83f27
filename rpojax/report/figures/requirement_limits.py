"""Limits of the requirements by metric and by channel, as figures draw them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rpojax.report.labels import metric_label, with_unit

CHANNEL_OF_METRIC: Final = {
    "formation_error_rms_m": "formation_error_m",
    "nav_relative_position_error_rms_m": "nav_relative_error_m",
    "nav_servicer_position_error_rms_m": "nav_servicer_error_m",
    "nav_target_position_error_rms_m": "nav_target_error_m",
    "min_range_m": "range_m",
    "final_range_m": "range_m",
    "max_range_m": "range_m",
    "delta_v_m_s": "delta_v_m_s",
    "wheel_speed_peak_fraction": "wheel_speed_fraction",
    "nees_mean": "nees",
    "nees_relative_mean": "nees_relative",
}
"""Channel over time that shows what a metric is made of."""
_SHORT_STATISTIC: Final = {"rms": "RMS", "mean": "mean", "final": "at the end"}


@dataclass(frozen=True)
class Limit:
    """Limit of a requirement on a metric: at most or at least `value`, in the metric's unit."""

    metric: str
    value: float
    at_most: bool
    window: str = ""

    @property
    def text(self) -> str:
        """Short text beside the line."""
        unit = metric_label(self.metric).unit
        return f"limit {with_unit(format(self.value, 'g'), unit)}"

    @property
    def channel_text(self) -> str:
        """Text beside the line in a chart of the channel, with the statistic that the limit is on."""
        words = [word for part, word in _SHORT_STATISTIC.items() if part in self.metric.partition("@")[0].split("_")]
        window = f" ({self.metric.partition('@')[2]})" if "@" in self.metric else ""
        return f"{self.text}{' on ' + ', '.join(words) if words else ''}{window}"

    def is_broken_by(self, values: np.ndarray) -> np.ndarray:
        """Flags of the values beyond the limit; a missing value is not beyond it."""
        return values > self.value if self.at_most else values < self.value


def limits_of_metrics(requirements: Sequence[Mapping[str, Any]]) -> dict[str, list[Limit]]:
    """Limits by metric, from the entries of report.json."""
    found: dict[str, list[Limit]] = {}
    for entry in requirements:
        name = entry.get("of", entry["metric"])
        limit = Limit(name, float(entry["limit"]), entry["bound"] == "at most")
        if limit not in found.setdefault(name, []):
            found[name].append(limit)
    return found


def limits_of_channels(requirements: Sequence[Mapping[str, Any]]) -> dict[str, list[Limit]]:
    """Limits by channel over time, for the requirements whose metric is made of one."""
    found: dict[str, list[Limit]] = {}
    for name, limits in limits_of_metrics(requirements).items():
        channel = CHANNEL_OF_METRIC.get(name.partition("@")[0])
        if channel is not None:
            found.setdefault(channel, []).extend(limits)
    return found
