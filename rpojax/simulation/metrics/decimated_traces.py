"""Traces: decimated scalar channels that a campaign stores of every run."""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from rpojax.metrics.metric_definition import Floats
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics.recorded_metrics import Records, Values, desired_position_H


class Trace(NamedTuple):
    """Definition of a trace: its unit, the channels it is made of, and its value (runs, samples) from these."""

    unit: str
    inputs: tuple[str, ...]
    value: Callable[..., Floats]


def _norm(vectors: Floats) -> Floats:
    return np.linalg.norm(vectors, axis=2)


def _itself(channel: Floats) -> Floats:
    return channel


TRACES: Final = {
    "formation_error_m": Trace(
        "m", ("rho_H", "desired_position_H"), lambda rho, desired: _norm(rho - desired.astype(np.float32))
    ),
    "nav_relative_error_m": Trace("m", ("relative_error_H",), _norm),
    "nav_relative_sigma3_m": Trace("m", ("relative_sigma_H",), lambda sigma: 3.0 * _norm(sigma)),
    "nav_servicer_error_m": Trace("m", ("servicer_error_H",), _norm),
    "nav_target_error_m": Trace("m", ("target_error_H",), _norm),
    "range_m": Trace("m", ("range_m",), _itself),
    "delta_v_m_s": Trace("m/s", ("delta_v_m_s",), _itself),
    "nees": Trace("-", ("nees",), _itself),
    "nees_relative": Trace("-", ("nees_relative",), _itself),
    "wheel_speed_fraction": Trace("-", ("wheel_speed_fraction",), lambda fraction: np.abs(fraction).max(axis=2)),
}
"""Traces by name."""

TRACE_UNITS: Final = {name: trace.unit for name, trace in TRACES.items()}
"""Unit of every trace by name."""


def decimated_traces(file: ScenarioFile, records: Records, varied: Values, every: int) -> dict[str, Floats]:
    """Traces (runs, samples), float32, from channels (runs, ticks, ...): one sample every `every` ticks.

    `varied` are the values of the runs (runs, ...) by key, of the keys that vary.
    """
    quantities = {**records, "desired_position_H": desired_position_H(file, records, varied)}
    return {
        name: trace.value(*(quantities[channel][:, ::every] for channel in trace.inputs)).astype(np.float32)
        for name, trace in TRACES.items()
    }
