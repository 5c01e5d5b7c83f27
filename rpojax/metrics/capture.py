"""Metrics of a capture: where the servicer truly is before the docking port of the target as the last phase begins."""

from collections.abc import Callable
from types import ModuleType
from typing import Any, Final

from rpojax.metrics.approach import length
from rpojax.metrics.metric_definition import Metric, WeightedValue


def _at_capture(
    name: str, unit: str, title: str, meaning: str, channel: str, value: Callable[[ModuleType, Any], Any]
) -> Metric:
    return Metric(
        name,
        unit,
        title=title,
        meaning=f"{meaning}, as the last phase begins.",
        inputs=(channel, "is_arrival"),
        value=lambda xp, each, is_arrival: WeightedValue(value(xp, each), is_arrival),
        reduction="max",
        has_derivative=True,
        needs="port",
    )


METRICS: Final = (
    _at_capture(
        "capture_lateral_m",
        "m",
        "Lateral offset at the port",
        "True distance of the servicer's centre of mass from the axis of the docking port",
        "port_place_P",
        lambda xp, place: length(xp, place[..., :2]),
    ),
    _at_capture(
        "capture_angle_deg",
        "deg",
        "Angle at the port",
        "True angle between the camera's boresight and the axis of the docking port, into it",
        "port_angle_deg",
        lambda _, angle: angle,
    ),
    _at_capture(
        "capture_speed_m_s",
        "m/s",
        "Speed at the port",
        "True speed of the servicer in the frame of the target, which turns",
        "port_velocity_P",
        length,
    ),
    Metric(
        "hull_distance_min_m",
        "m",
        title="Distance of the hulls",
        meaning="Smallest true distance between the convex hull of the target and a sphere of `servicer.radius_m` "
        "about the servicer's centre of mass, negative where they overlap.",
        inputs=("hull_distance_m",),
        reduction="min",
        low_is_bad=True,
        has_derivative=True,
        needs="port",
    ),
)
"""Metrics of missions whose last phase is in the frame of the target."""
