"""Missions that cannot be flown are refused in one line."""

from typing import Any

import pytest
from scenario_error_assertions import assert_one_line

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture
def tables(inspection_file: ScenarioFile) -> dict[str, Any]:
    """Tables of the scenario `inspection`."""
    return inspection_file.model_dump()


FIRST = {"name": "far", "reference": {"kind": "hold", "position_m": [0.0, -60.0, 0.0]}, "until": {"time_s": 600.0}}
LAST = {"name": "near", "reference": {"kind": "hold", "position_m": [0.0, -30.0, 0.0]}}

BAD: dict[str, tuple[list[dict[str, Any]], str, tuple[str, ...]]] = {
    "same name": ([FIRST, FIRST | {"until": None}], "phases.name", ("no other phase",)),
    "built-in name": ([LAST | {"name": "hold"}], "phases.name", ("aborted",)),
    "never ends": ([{k: v for k, v in FIRST.items() if k != "until"}, LAST], "phases.far", ("timeout_s",)),
    "ends after the run": ([FIRST | {"until": {"time_s": 1e5}}, LAST], "phases.far.until.time_s", ("6000",)),
    "no condition": ([FIRST | {"until": {}}, LAST], "phases.far.until", ("time_s",)),
    "duration without its limit": (
        [FIRST | {"until": {"arrival_for_s": 10.0}}, LAST],
        "phases.far.until.arrival_for_s",
        ("arrival_box_m",),
    ),
    "period too short": ([LAST | {"control_period_s": 100.0}], "phases.near.control_period_s", ("115",)),
    "period between decisions": ([LAST | {"control_period_s": 210.0}], "phases.near.control_period_s", ("20 s",)),
    "inside the keep-out zone": (
        [LAST | {"keep_out_m": [10.0, 40.0, 10.0]}],
        "phases.near.reference",
        ("keep-out zone", "40 m"),
    ),
    "outside its corridor": (
        [LAST | {"corridor": {"axis": [0.0, 1.0, 0.0], "half_angle_deg": 10.0, "width_m": 1.0}}],
        "phases.near.reference",
        ("phases.near.corridor",),
    ),
    "walking ellipse through the target": (
        [LAST | {"reference": {"kind": "relative_orbit", "radial_m": 20.0, "drift_per_orbit_m": 100.0}}],
        "phases.near.reference",
        ("keep-out zone",),
    ),
    "impulse too large": (
        [LAST | {"reference": {"kind": "transfer", "position_m": [0.0, -500.0, 0.0], "duration_s": 600.0}}],
        "phases.near.reference.duration_s",
        ("36.6 mm/s", "pulses"),
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_mission_that_cannot_be_flown_is_refused(tables: dict[str, Any], name: str) -> None:
    phases, key, words = BAD[name]
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(
            tables | {"phases": [{k: v for k, v in each.items() if v is not None} for each in phases]}
        )
    assert_one_line(caught.value, key, *words)


def test_settings_of_the_mission_need_phases(tables: dict[str, Any]) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables | {"mission": {"abort_at_s": 100.0}})
    assert_one_line(caught.value, "mission", "phases")


def test_a_key_of_a_phase_is_set_by_the_name_of_the_phase(tmp_path: Any) -> None:
    path = tmp_path / "mission.toml"
    path.write_text(
        'extends = "inspection"\nname = "m"\n[[phases]]\nname = "near"\n'
        'reference = { kind = "hold", position_m = [0.0, -30.0, 0.0] }\n'
    )
    file = scenario_loader.load(
        path, ["phases.near.timeout_s=500", "phases.near.reference.position_m=[0.0, -40.0, 0.0]"]
    )
    assert (file.phases[0].timeout_s, file.phases[0].reference.position_m) == (500.0, [0.0, -40.0, 0.0])
    with pytest.raises(ScenarioError, match="did you mean 'near'"):
        scenario_loader.load(path, ["phases.neer.timeout_s=500"])
