"""Scenarios and parameters of the servicers of a team."""

from dataclasses import replace
from typing import Any

import jax
import numpy as np
import pytest

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import build_params
from rpojax.scenario.phases.reference_sections import RelativeOrbitSection
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings
from rpojax.scenario.team.members import member_files, member_names, member_params


@pytest.fixture
def team(tables: dict[str, Any]) -> ScenarioFile:
    """The team as its file model."""
    return scenario_loader.validate(tables)


def test_a_servicer_alone_is_its_own_member(inspection_file: ScenarioFile) -> None:
    assert member_names(inspection_file) == ()
    assert member_files(inspection_file) == (inspection_file,)
    assert len(member_params(inspection_file)) == 1
    assert static_settings(inspection_file, allow_team=True).team is None


def test_each_servicer_has_the_scenario_with_its_own_keys(team: ScenarioFile, tables: dict[str, Any]) -> None:
    assert member_names(team) == ("first", "second", "third")
    first, second, third = member_files(team)
    assert first == scenario_loader.ScenarioFile.model_validate({**tables, "servicers": []})
    assert second.initial.relative_position_m == [0.0, -50.0, -30.0]
    assert second.initial.relative_velocity_m_s == first.initial.relative_velocity_m_s
    assert isinstance(second.phases[0].reference, RelativeOrbitSection)
    assert (second.phases[0].reference.radial_phase_deg, second.phases[0].reference.radial_m) == (180.0, 25.0)
    assert (second.phases[0].timeout_s, first.phases[0].timeout_s) == (9000.0, None)
    assert (third.servicer.mass_kg, third.servicer.inertia_kg_m2) == (20.0, first.servicer.inertia_kg_m2)
    assert [member.servicers for member in (first, second, third)] == [[], [], []]


def test_a_team_survives_being_written_and_read(team: ScenarioFile) -> None:
    assert scenario_loader.validate(team.model_dump()) == team
    assert ScenarioFile.model_validate_json(team.model_dump_json()) == team


def test_parameters_of_servicers_can_be_stacked(team: ScenarioFile) -> None:
    params = member_params(team)
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves, axis=-1), *params)
    np.testing.assert_array_equal(stacked.plant.servicer.mass, [30.0, 30.0, 20.0])
    np.testing.assert_array_equal(stacked.flight.vehicle.mass, [30.0, 30.0, 20.0])
    own = member_files(team)[1]
    alone = build_params(own.model_dump(), own.camera.width_px, own.camera.height_px)
    assert jax.tree.all(jax.tree.map(np.array_equal, params[1], alone))


def test_parameters_hold_links_and_differences(tables: dict[str, Any]) -> None:
    tables["link"] = {
        "loss": 0.3,
        "burst_loss": 0.9,
        "burst_interval_s": 600.0,
        "outages_s": [[10.0, 20.0], [30.0, 35.0]],
    }
    tables["gps_differences"] = {"kind": "carrier", "noise_m": 0.04}
    tables["navigation"] |= {"difference_noise_m": 0.05, "difference_error_sigma_m": 0.01}
    tables["navigation"] |= {"difference_range_noise_m": 0.3, "difference_range_bias_sigma_m": 0.2}
    tables["link_range"] = {"enabled": True, "noise_m": 0.25}
    for params in member_params(scenario_loader.validate(tables)):
        assert (float(params.link.loss), float(params.link.burst_loss)) == (0.3, 0.9)
        assert (float(params.link.burst_interval), float(params.link.burst_duration)) == (600.0, 10.0)
        np.testing.assert_array_equal(params.link.outage_start, [10.0, 30.0])
        np.testing.assert_array_equal(params.link.outage_end, [20.0, 35.0])
        assert (float(params.gps_differences.noise), float(params.gps_differences.slow_error)) == (0.04, 0.007)
        assert (float(params.baseline.noise), float(params.baseline.error_sigma)) == (0.05, 0.01)
        assert float(params.baseline.error_time_constant) == 700.0
        assert (float(params.baseline.range_noise), float(params.baseline.range_bias_sigma)) == (0.3, 0.2)
        assert (float(params.link_range.noise), float(params.link_range.bias_sigma)) == (0.25, 0.05)
        assert float(params.gps.common_share) == 0.9


def test_static_settings_of_a_team(tables: dict[str, Any]) -> None:
    tables["link"] = {
        "period_s": 2.0,
        "delay_s": 3.0,
        "hears": [["first", "third"], ["second", "first"], ["third", "first"]],
    }
    tables["gps_differences"] = {"kind": "carrier"}
    team = static_settings(scenario_loader.validate(tables), allow_team=True).team
    assert team is not None
    assert (team.servicers, team.carrier_differences) == (3, True)
    link = team.link
    assert (link.servicers, link.sharing, link.period_ticks, link.delay_ticks) == (3, "boxes", 2, 3)
    assert not link.ranging
    assert link.hears == ((0, 2), (1, 0), (2, 0))
    tables["navigation"]["sharing"] = "central"
    tables["link_range"] = {"enabled": True}
    central = static_settings(scenario_loader.validate(tables), allow_team=True).team
    assert central is not None
    assert central.link.ranging
    assert (central.link.period_ticks, central.link.delay_ticks, len(central.link.hears)) == (1, 0, 6)


def test_the_rest_of_the_static_settings_is_that_of_a_servicer_alone(
    team: ScenarioFile, tables: dict[str, Any]
) -> None:
    alone = static_settings(scenario_loader.ScenarioFile.model_validate({**tables, "servicers": []}))
    of_team = static_settings(team, allow_team=True)
    assert of_team.team is not None
    assert of_team.mission is not None
    assert of_team.mission.servicers == of_team.team.servicers == 3
    assert {**vars(of_team), "team": None, "mission": replace(of_team.mission, servicers=1)} == vars(alone)


def test_burn_decisions_of_servicers_are_shared_out_over_the_burn_period(tables: dict[str, Any]) -> None:
    """200 s between burns and decisions every 20 s, by hand: a third is 67 s, next to 60 s, and two thirds 140 s."""

    def offsets() -> tuple[int, ...]:
        team = static_settings(scenario_loader.validate(tables), allow_team=True).team
        assert team is not None
        return team.decision_offsets

    assert offsets() == (0, 60, 140)
    tables["servicers"][2]["decision_offset_s"] = 20.0
    assert offsets() == (0, 60, 20)
    del tables["servicers"][2]["decision_offset_s"]
    del tables["servicers"][1]["phases"]
    tables["phases"] = []
    tables["requirements"] = []
    assert offsets() == (0, 67, 133)


def test_the_digest_depends_on_what_differs(tables: dict[str, Any], team: ScenarioFile) -> None:
    tables["servicers"][2]["servicer"]["mass_kg"] = 21.0
    assert scenario_digest(scenario_loader.validate(tables)) != scenario_digest(team)


def test_overrides_set_and_make_keys_of_a_servicer(tmp_path: Any) -> None:
    path = tmp_path / "team.toml"
    path.write_text(
        'extends = "safety_ellipse"\n[[servicers]]\nname = "a"\n[[servicers]]\nname = "b"\n'
        "initial = { relative_position_m = [0.0, -50.0, -30.0] }\n"
    )
    changed = scenario_loader.load(
        path,
        [
            "servicers.b.phases.inspect.reference.radial_phase_deg=170",
            "servicers.b.limits.propellant_kg=1.0",
            "link.loss=0.2",
        ],
    )
    second = member_files(changed)[1]
    assert isinstance(second.phases[0].reference, RelativeOrbitSection)
    assert second.phases[0].reference.radial_phase_deg == 170.0
    assert (second.limits.propellant_kg, second.link.loss) == (1.0, 0.2)
    with pytest.raises(ScenarioError, match=r"did you mean 'b'"):
        scenario_loader.load(path, ["servicers.bb.limits.propellant_kg=1.0"])
