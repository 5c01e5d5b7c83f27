"""Metrics of an approach: the true place as the last phase of a mission begins, and the speed close to the target."""

from types import ModuleType
from typing import Final

from rpojax.metrics.metric_definition import Metric, Quantity, WeightedValue
from rpojax.metrics.record_statistics import greatest_fall

CLOSE_M: Final = 20.0
"""Range below which the closing speed counts [m]."""
_LEAST_SQUARE: Final = 1e-18
"""Keeps the derivative of a distance defined where there is none [m^2]."""


def _lateral(xp: ModuleType, rho: Quantity, axis: Quantity, is_arrival: Quantity) -> WeightedValue:
    """Distance from the axis of the approach, through the centre of mass."""
    unit = axis / xp.sqrt(xp.sum(axis * axis, axis=-1, keepdims=True))
    across = rho - xp.sum(rho * unit, axis=-1, keepdims=True) * unit
    return WeightedValue(length(xp, across), is_arrival)


def _along(xp: ModuleType, rho: Quantity, desired: Quantity, is_arrival: Quantity) -> WeightedValue:
    """Size of the true range minus that of the reference: too near is as bad as too far."""
    return WeightedValue(xp.abs(length(xp, rho) - length(xp, desired)), is_arrival)


def length(xp: ModuleType, vector: Quantity) -> Quantity:
    """Length of a vector along the last axis."""
    return xp.sqrt(xp.maximum(xp.sum(vector * vector, axis=-1), _LEAST_SQUARE))


METRICS: Final = (
    Metric(
        "final_lateral_error_m",
        "m",
        title="Lateral error at arrival",
        meaning="True distance from the axis of the approach, through the target's centre of mass, as the last phase "
        "begins: that of its corridor, or the direction of its reference without one and in the target's frame.",
        inputs=("rho_H", "approach_axis_H", "is_arrival"),
        value=_lateral,
        reduction="max",
        has_derivative=True,
        needs="phases",
    ),
    Metric(
        "final_range_error_m",
        "m",
        title="Range error at arrival",
        meaning="Size of the true range to the target's centre of mass minus that of the reference, too near or too "
        "far, as the last phase begins.",
        inputs=("rho_H", "desired_position_H", "is_arrival"),
        value=_along,
        reduction="max",
        has_derivative=True,
        needs="phases",
    ),
    Metric(
        "closing_speed_max_m_s",
        "m/s",
        title="Closing speed",
        meaning=f"Greatest true rate towards the target within {CLOSE_M:g} m of it, from tick to tick.",
        inputs=("range_m",),
        value=lambda _, reach: WeightedValue(reach, reach < CLOSE_M),
        reduction=greatest_fall,
        needs="phases",
    ),
)
"""Metrics of scenarios with phases; a phase that begins again arrives again."""
