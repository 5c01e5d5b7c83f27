"""Traces of synthetic records."""

from typing import Any

import numpy as np
import pytest
from synthetic_channel_records import SINGLE, perfect_run

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import decimated_traces


@pytest.fixture(scope="module")
def hour() -> ScenarioFile:
    """The nominal scenario."""
    return scenario_loader.load("inspection")


def test_traces_are_norms_of_every_nth_tick(hour: ScenarioFile) -> None:
    records: dict[str, Any] = perfect_run(runs=2)
    records["relative_error_H"][1, 20] = [2.0, 3.0, 6.0]
    records["wheel_speed_fraction"][1, 20] = [0.1, -0.5, 0.2]
    found = decimated_traces.decimated_traces(hour, records, {}, 10)
    assert set(found) == set(decimated_traces.TRACE_UNITS)
    assert all(values.shape == (2, 9) and values.dtype == np.float32 for values in found.values())
    assert found["nav_relative_error_m"][1, 2] == 7.0
    assert found["wheel_speed_fraction"][1, 2] == 0.5
    np.testing.assert_allclose(found["nav_relative_sigma3_m"], 3.0 * np.sqrt(3.0), rtol=SINGLE)
