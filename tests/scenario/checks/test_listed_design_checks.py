"""Designs that are refused."""

import math
from typing import Any

import pytest
from scenario_variants import with_sections

from rpojax.errors import ScenarioError
from rpojax.scenario.schema import ScenarioFile


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({}, "design.values"),
        ({"gps.noise_m": []}, "design.values.gps.noise_m"),
        ({"gps.noise_m": ["a"]}, "design.values.gps.noise_m.0"),
        ({"gps.noise_m": [math.inf]}, "design.values.gps.noise_m.0"),
        ({"gps.noise_m": [[1.0]]}, "design.values.gps.noise_m"),
        ({"gps.noise_m": [1.0, -1.0]}, "design.values.gps.noise_m"),
        ({"initial.relative_position_m": [[1.0, 2.0]]}, "design.values.initial.relative_position_m"),
        ({"target.attitude": [[0.0, 0.0, 0.0, 0.0]]}, "design.values.target.attitude"),
        ({"gps.noise_m": [1.0], "gps": {"noise_m": [1.0]}}, "design.values.gps"),
        ({"target.tumble_axis": [[0.0, 0.0, 1.0]], "target.tumble_axis[0]": [1.0]}, "design.values"),
    ],
    ids=str,
)
def test_an_invalid_grid_is_refused(inspection_file: ScenarioFile, values: Any, named: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        with_sections(inspection_file, design={"kind": "grid", "values": values})
    assert str(refused.value).startswith(f"{named}: found")


@pytest.mark.parametrize(
    "design",
    [{}, {"kind": "random"}, {"kind": "sobol", "values": {}}, {"kind": "independent", "file": "a.csv"}, 3],
    ids=str,
)
def test_a_design_of_unknown_kind_or_with_unknown_settings_is_refused(
    inspection_file: ScenarioFile, design: Any
) -> None:
    with pytest.raises(ScenarioError, match=r"^design"):
        with_sections(inspection_file, design=design)
