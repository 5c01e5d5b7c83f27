"""Tests of the checks of the lamp, and of what a scenario with one says."""

from typing import Any

import pytest

import rpojax
from rpojax.errors import ScenarioError
from rpojax.scenario import params
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import leaf_path_and_factor
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.target_light import light_warnings
from tests.scenario_error_assertions import assert_one_line

LAMP = ["lamp.reach_m=60", "lamp.beam_half_angle_deg=20", "lamp.boresight=[1.0, 0.0, 0.0]"]


@pytest.mark.parametrize(
    ("scenario", "changes", "key", "words"),
    [
        ("inspection", ["lamp.reach_m=29.9"], "lamp.reach_m", "at least 30"),
        ("final_approach", ["lamp.reach_m=2.9"], "lamp.reach_m", "at least 3,"),
        ("inspection", ["lamp.boresight=[0.9, 0.4, 0.0]"], "lamp.boresight", "within beam_half_angle_deg = 20"),
        ("inspection", ["camera.model=rendered"], "camera.model", "one light, the Sun"),
    ],
)
def test_a_lamp_that_cannot_light_the_target_is_refused(
    scenario: str, changes: list[str], key: str, words: str
) -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load(scenario, [*LAMP, *changes])
    assert_one_line(refused.value, key, words)


def test_a_lamp_is_off_without_a_reach() -> None:
    off = rpojax.load("inspection", [*LAMP, "lamp.reach_m=0", "camera.model=rendered"])
    assert off.lamp is not None
    on = ['dispersions.lamp.reach_m={kind = "uniform", low = 30.0, high = 60.0}']
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("inspection", [*LAMP, "lamp.reach_m=0", "camera.model=rendered", *on])
    assert_one_line(refused.value, "camera.model", "one light, the Sun")


def test_flight_software_has_the_nominal_lamp() -> None:
    file = rpojax.load("inspection", LAMP)
    made = params.build_params(file.model_dump(), file.camera.width_px, file.camera.height_px)
    assert made.lamp is not None
    assert made.flight.vehicle.lamp is not None
    assert float(made.lamp.reach) == float(made.flight.vehicle.lamp.reach) == 60.0
    path, _ = leaf_path_and_factor("lamp.reach_m")
    assert path == ("lamp", "reach")  # a dispersion is one of the truth


def test_a_station_in_the_reach_of_the_lamp_needs_no_light() -> None:
    def unlit(*changes: str) -> list[str]:
        file = rpojax.load("inspection", ["orbit.raan_deg=0", "camera.phase_limit_deg=60", *changes])
        return [line for line in light_warnings(file, DispersedReach(file)) if "station" in line]

    assert unlit()
    assert unlit(*LAMP, "camera.sun_exclusion_deg=0") == []


def test_a_scenario_without_a_lamp_has_no_such_section(inspection_tables: dict[str, Any]) -> None:
    assert "lamp" not in inspection_tables
    with_lamp = scenario_loader.load("inspection", LAMP).model_dump()
    assert with_lamp["lamp"] == {"boresight": [1.0, 0.0, 0.0], "beam_half_angle_deg": 20.0, "reach_m": 60.0}
    assert scenario_loader.validate(with_lamp).lamp is not None


@pytest.fixture(scope="module")
def inspection_tables() -> dict[str, Any]:
    return rpojax.load("inspection").model_dump()
