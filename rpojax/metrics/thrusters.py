"""Metrics of thrusters that fail: how soon one that is stuck open is shut off, and how many are."""

from types import ModuleType
from typing import Final

from rpojax.metrics.metric_definition import Metric, Quantity, WeightedValue


def _delay(xp: ModuleType, delay: Quantity) -> WeightedValue:
    return WeightedValue(delay, ~xp.isnan(delay))


METRICS: Final = (
    Metric(
        "isolation_delay_s",
        "s",
        title="Time until isolation",
        meaning="Time for which a thruster that is stuck open can burn: from the failure until its isolation valve is "
        "shut, or until the run ends or the fault is over.",
        inputs=("isolation_delay_s",),
        value=_delay,
        reduction="max",
        of_events=True,
        needs="isolation",
    ),
    Metric(
        "isolated_thrusters",
        "-",
        title="Isolated thrusters",
        meaning="Thrusters that flight software has shut off by their isolation valves.",
        inputs=("isolated_thrusters",),
        reduction="max",
        needs="isolation",
    ),
)
"""Metrics of scenarios in which thrusters are isolated."""
