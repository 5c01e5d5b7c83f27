"""Traces: decimated scalar channels that a campaign stores of every run."""

from typing import Final

import numpy as np

from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics.recorded_metrics import Floats, Records

TRACE_UNITS: Final = {
    "formation_error_m": "m",
    "nav_relative_error_m": "m",
    "nav_relative_sigma3_m": "m",
    "nav_servicer_error_m": "m",
    "nav_target_error_m": "m",
    "range_m": "m",
    "delta_v_m_s": "m/s",
    "nees": "-",
    "nees_relative": "-",
    "wheel_speed_fraction": "-",
}
"""Unit of every trace by name."""


def decimated_traces(file: ScenarioFile, records: Records, every: int) -> dict[str, Floats]:
    """Traces (runs, samples), float32, from channels (runs, ticks, ...): one sample every `every` ticks."""

    def norm(name: str) -> Floats:
        return np.linalg.norm(records[name][:, ::every], axis=2)

    desired = np.asarray(file.formation.desired_position_m, dtype=np.float32)
    values = {
        "formation_error_m": np.linalg.norm(records["rho_H"][:, ::every] - desired, axis=2),
        "nav_relative_error_m": norm("relative_error_H"),
        "nav_relative_sigma3_m": 3.0 * norm("relative_sigma_H"),
        "nav_servicer_error_m": norm("servicer_error_H"),
        "nav_target_error_m": norm("target_error_H"),
        "range_m": records["range_m"][:, ::every],
        "delta_v_m_s": records["delta_v_m_s"][:, ::every],
        "nees": records["nees"][:, ::every],
        "nees_relative": records["nees_relative"][:, ::every],
        "wheel_speed_fraction": np.abs(records["wheel_speed_fraction"][:, ::every]).max(axis=2),
    }
    return {name: value.astype(np.float32) for name, value in values.items()}
