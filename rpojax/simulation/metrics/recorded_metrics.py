"""Metrics of runs from their recorded channels; an undefined metric is NaN, and null in a report."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.metrics.metric_catalogue import METRICS
from rpojax.metrics.metric_definition import Floats, RunTiming
from rpojax.metrics.recorded_reduction import reduce_records
from rpojax.scenario.schema import ScenarioFile

Records = Mapping[str, np.ndarray]

_DERIVED: Final = {"desired_position_H", "is_settled"}
"""Inputs of metrics that are no channels."""

REQUIRED_CHANNELS: Final = tuple(
    sorted({"mode"} | {name for metric in METRICS.values() if metric.is_recorded for name in metric.inputs} - _DERIVED)
)
"""Channels that the metrics read."""


def evaluate(file: ScenarioFile, records: Records) -> dict[str, Floats]:
    """Metrics (runs,) from channels of shape (runs, ticks) or (runs, ticks, components), at the camera rate."""
    tick_s = 1.0 / file.rates.camera_hz
    timing = RunTiming(tick_s, decision_ticks=round(file.rates.formation_period_s / tick_s))
    quantities = {
        **records,
        "desired_position_H": desired_position_H(file, records),
        "is_settled": _is_settled(records["mode"], round(file.pointing.settle_time_s / tick_s)),
    }
    return {name: reduce_records(metric, quantities, timing) for name, metric in METRICS.items() if metric.is_recorded}


def desired_position_H(file: ScenarioFile, records: Records) -> Floats:
    """Desired relative position (runs, ticks, 3) of the scenario [m]; that of a run may differ, and is not recorded."""
    return np.broadcast_to(np.asarray(file.formation.desired_position_m), records["rho_H"].shape)


def _is_settled(mode: NDArray[np.integer], settle_ticks: int) -> NDArray[np.bool_]:
    """Whether the camera has pointed at the target for the settling time, or since the start (runs, ticks)."""
    looking = mode == Mode.LOOK
    settled = looking.copy()
    for shift in range(1, settle_ticks + 1):
        settled[:, shift:] &= looking[:, :-shift]
    return settled
