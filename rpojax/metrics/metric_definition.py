"""Definition of a metric: its value at a tick from named quantities, and its reduction over time; free of JAX."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]
Quantity = Any
"""Array of NumPy, (runs, ticks) or (runs, ticks, components), or of JAX at one tick, () or (components,)."""
Window = Literal["all", "late", "last"]
"""All ticks, or those of one of the windows of `time_windows`."""
Reduction = Literal["mean", "rms", "sum", "min", "max", "end", "total"]
"""Reduction over time that can be accumulated tick by tick.

`rms` is that of the norm over components, `end` the scalar value at the last tick, `total` the same of a quantity that
accumulates from the start; the others are over ticks and components alike. Each is undefined, NaN, where no tick of the
window has a weight (for `end` and `total`, where the last one has none), and where a value with a weight is NaN.
"""


Need = Literal["phases", "plume", "isolation", "coverage", "landmarks", "port"]
"""What only some scenarios have: phases, plumes on the target, isolation valves, coverage of the target, landmarks,
and a last phase before a docking port."""

Source = Literal["records", "drifts", "coverage", "team", "simulation", "plugin"]


class WeightedValue(NamedTuple):
    """Value at a tick, and its weight in sums and means, not negative; where it is 0 the value does not count."""

    value: Quantity
    weight: Quantity


class RunTiming(NamedTuple):
    """Duration of a tick [s], ticks from one burn decision to the next, and number of the first tick."""

    tick_s: float
    decision_ticks: int
    first_tick: int = 0


RecordStatistic = Callable[[WeightedValue, RunTiming], Floats]
"""Reduction over time that needs the whole record: value and weight (runs, ticks, ...) to the metric (runs,)."""


def _single_input(_: ModuleType, quantity: Quantity) -> Quantity:
    return quantity


@dataclass(frozen=True)
class Metric:
    """Definition of a metric.

    Attributes:
        name: with its unit as suffix
        unit: as text, `-` if there is none
        title: for people
        meaning: in one sentence
        inputs: names of the quantities of a tick that it is made of: channels, and those of `simulation/metrics`
        reduction: over the ticks of the window; a statistic of whole records cannot be evaluated during the simulation.
            Without it the metric is not made of ticks
        value: from an array namespace (NumPy or JAX's) and the inputs, components in the last axis, to the value at a
            tick, or to value and weight; without it the metric is made of its only input
        window: ticks that count
        low_is_bad: low values are the worse ones
        has_derivative: its derivative is useful: it is no count, no percentile and no step function
        degrees_of_freedom: of a normalised square, which is its mean if the filter is consistent; None for others
        of_events: it judges what need not happen, such as a wait after an eclipse: of a team those servicers count to
            which it did
        needs: what a scenario must have for it; None for a metric of all
        source: evaluated from `records` or from free `drifts`, and so for every run of a campaign; from the `coverage`
            of the target's surface, for those of a scenario with it; of a `team`, for those with several servicers;
            during the `simulation` alone; or from records as a `plugin` defines it, for the scenarios that have it
    """

    name: str
    unit: str
    title: str
    meaning: str
    inputs: tuple[str, ...] = ()
    reduction: Reduction | RecordStatistic | None = None
    value: Callable[..., Quantity | WeightedValue] = _single_input
    window: Window = "all"
    low_is_bad: bool = False
    has_derivative: bool = False
    degrees_of_freedom: int | None = None
    of_events: bool = False
    needs: Need | None = None
    source: Source = "records"

    def weighted_value(self, namespace: ModuleType, quantities: Mapping[str, Quantity]) -> WeightedValue:
        """Value and weight of `quantities`; the weight is None where all ticks count alike."""
        value = self.value(namespace, *(quantities[name] for name in self.inputs))
        return value if isinstance(value, WeightedValue) else WeightedValue(value, None)
