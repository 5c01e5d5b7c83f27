"""Titles, meanings and units of metrics and channels, as readers see them."""

from collections.abc import Iterable
from dataclasses import dataclass

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
