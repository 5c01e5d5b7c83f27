"""Metrics of the trajectory: velocity change and range."""

from typing import Final

from rpojax.metrics.metric_definition import Metric

METRICS: Final = (
    Metric(
        "delta_v_m_s",
        "m/s",
        title="Delta-v",
        meaning="Velocity change that the thruster applied over the whole run.",
        inputs=("delta_v_m_s",),
        reduction="total",
        has_derivative=True,
    ),
    Metric(
        "min_range_m",
        "m",
        title="Minimum range",
        meaning="Smallest true distance of the two spacecraft.",
        inputs=("range_m",),
        reduction="min",
        low_is_bad=True,
        has_derivative=True,
    ),
    Metric(
        "final_range_m",
        "m",
        title="Final range",
        meaning="True distance of the two spacecraft at the end of the run.",
        inputs=("range_m",),
        reduction="end",
        low_is_bad=True,
        has_derivative=True,
    ),
)
