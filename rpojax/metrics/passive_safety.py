"""Metrics of passive safety: free drifts after a loss of thrust, and after a thruster that stays open."""

import re
from typing import Final

from rpojax.metrics.metric_definition import Metric

STANDARD_HORIZONS: Final = ("1_orbit", "4_orbits", "24_h")
"""Horizons of the packaged scenarios."""
UNSAFE_FRACTION: Final = "passive_unsafe_fraction"
STUCK_ON_RANGE: Final = "stuck_on_range_24_h_m"
FINAL_DRIFT_RANGE: Final = "final_drift_range_24_h_m"
ONE_ORBIT_RANGE: Final = "passive_range_m"

_HORIZON = re.compile(r"([1-9][0-9]{0,3})_(orbits?|h)")
_METRIC = re.compile(r"passive_range_(.+)_m")


def horizon_length(horizon: str) -> tuple[int, bool]:
    """Number and whether it counts orbits (else hours) of a horizon such as `4_orbits` or `24_h`.

    Raises:
        ValueError: it is none.
    """
    match = _HORIZON.fullmatch(horizon)
    if match is None or (match[2] == "orbit") != (match[1] == "1" and match[2] != "h"):
        raise ValueError("expected horizons such as '1_orbit', '4_orbits' or '24_h'")
    return int(match[1]), match[2] != "h"


def horizon_metric_name(horizon: str) -> str:
    """Name of the metric of a horizon."""
    return f"passive_range_{horizon}_m"


def horizon_metric(horizon: str) -> Metric:
    """Metric of a horizon.

    Raises:
        ValueError: it is none.
    """
    count, in_orbits = horizon_length(horizon)
    span = f"{count} h" if not in_orbits else "one orbit" if count == 1 else f"{count} orbits"
    return Metric(
        horizon_metric_name(horizon),
        "m",
        title=f"Passive range, {span}",
        meaning=f"Smallest distance within {span} of free drift, under the plant's forces, after a loss of thrust.",
        source="drifts",
        low_is_bad=True,
    )


def is_of_horizon(name: str) -> bool:
    """Whether a metric of that name is the range within a horizon."""
    return metric_of_horizon(name) is not None


def metric_of_horizon(name: str) -> Metric | None:
    """The metric of that name, if it is the range within a horizon."""
    match = _METRIC.fullmatch(name)
    try:
        return None if match is None else horizon_metric(match[1])
    except ValueError:
        return None


METRICS: Final = (
    *(horizon_metric(horizon) for horizon in STANDARD_HORIZONS),
    Metric(
        UNSAFE_FRACTION,
        "-",
        title="Unsafe share of the time",
        meaning="Share of the time from which free drift enters the keep-out sphere within the longest horizon.",
        source="drifts",
    ),
    Metric(
        STUCK_ON_RANGE,
        "m",
        title="Stuck-on range, 24 h",
        meaning="Smallest distance within 24 h of free drift after a burn whose thruster stayed open.",
        source="drifts",
        low_is_bad=True,
    ),
    Metric(
        FINAL_DRIFT_RANGE,
        "m",
        title="Final drift range, 24 h",
        meaning="Smallest distance from the last burn to 24 h after the end of the run, in free drift.",
        source="drifts",
        low_is_bad=True,
    ),
    Metric(
        ONE_ORBIT_RANGE,
        "m",
        title="Passive range",
        meaning="Former name of the passive range of one orbit.",
        source="drifts",
        low_is_bad=True,
    ),
)


def is_of_drifts(name: str) -> bool:
    """Whether a metric of that name is evaluated from free drifts."""
    return is_of_horizon(name) or any(metric.name == name for metric in METRICS)
