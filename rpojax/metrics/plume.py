"""Metric of the plumes of small thrusters on the target."""

from typing import Final

from rpojax.metrics.metric_definition import Metric

METRICS: Final = (
    Metric(
        "plume_impulse_n_s",
        "N s",
        title="Impulse of plumes on the target",
        meaning="Impulse that the plumes of all thrusters gave the target over the whole run, summed in size.",
        inputs=("plume_impulse_n_s",),
        reduction="total",
        has_derivative=True,
        needs="plume",
    ),
)
"""Metrics of scenarios in which plumes push the target."""
