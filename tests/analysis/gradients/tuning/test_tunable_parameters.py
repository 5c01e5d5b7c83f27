"""Tunable parameters: their initial coordinates, and what is refused."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from isolated_plugins import forgotten_plugins

import rpojax
from rpojax.analysis.gradients.tuning import tunable_parameters, tune
from rpojax.analysis.gradients.tuning.tunable_parameters import GROUPS, TUNABLE
from rpojax.errors import ScenarioError
from rpojax.scenario import params, schema
from rpojax.scenario.parameter_keys import nominal_of_key

INSPECTION = rpojax.load("inspection")


@pytest.mark.parametrize("key", TUNABLE)
def test_every_tunable_key_is_a_number_of_flight_software(key: str) -> None:
    path, _ = params.leaf_path_and_factor(key)
    assert path[0] == "flight"
    assert nominal_of_key(INSPECTION, key) is not None


@pytest.mark.parametrize("group", GROUPS)
def test_the_start_of_a_group_is_the_scenario_as_it_is(group: str) -> None:
    file = rpojax.load("pose_inspection") if group == "pose" else INSPECTION
    chosen = tunable_parameters.select_parameters(file, [group])
    assert len(chosen.names) == chosen.count == len(chosen.initial)
    for key, value in chosen.values(jnp.asarray(chosen.initial)).items():
        np.testing.assert_allclose(value, nominal_of_key(file, key), rtol=1e-12)


def test_the_pose_filter_is_tuned_only_where_there_are_landmarks() -> None:
    chosen = tunable_parameters.select_parameters(rpojax.load("pose_inspection"), ["pose"])
    assert chosen.count == 4 and not chosen.held_fixed
    with pytest.raises(ScenarioError, match="parameters: found 'pose', expected at least one number"):
        tunable_parameters.select_parameters(INSPECTION, ["pose"])


def test_a_weight_of_zero_is_held_fixed_in_its_group() -> None:
    assert tunable_parameters.select_parameters(INSPECTION, ["formation"]).held_fixed == ("formation.velocity_weight",)


@pytest.mark.parametrize("x", [-50.0, -1.0, 50.0])
def test_any_lead_time_lets_the_look_away_fit_between_two_decisions(x: float) -> None:
    chosen = tunable_parameters.select_parameters(INSPECTION, ["formation.lead_s"])
    lead = float(chosen.values(jnp.asarray([x]))["formation.lead_s"])
    tuned = tune.tuned_scenario(INSPECTION, {"formation.lead_s": lead})
    assert tuned.formation.lead_s == lead


def test_names_may_overlap() -> None:
    both = tunable_parameters.select_parameters(INSPECTION, ["navigation", "navigation.edge_noise_px"])
    assert list(both.nominal) == list(GROUPS["navigation"])


@pytest.mark.parametrize(
    ("names", "overrides", "message"),
    [
        (["navigate"], [], "parameters: found 'navigate', expected one of navigation, pose, gate, formation,"),
        (["navigation.edge_noise"], [], "did you mean 'navigation.edge_noise_px'"),
        (["servicer.mass_kg"], [], "parameters: found 'servicer.mass_kg'"),
        (["formation.velocity_weight"], [], r"formation.velocity_weight: found \[0.0, 0.0, 0.0\], expected a positive"),
        (["gate"], ["navigation.gate_sigma=15"], "parameters: found 'gate', expected at least one number"),
        (["navigation.gate_sigma"], ["navigation.gate_sigma=15"], "found 15.0, expected a start between 1.5 and 12"),
        (["navigation.gate_sigma"], ["navigation.gating=none"], "found 4.0, expected navigation.gating = 'covariance'"),
        (["gate"], ["navigation.gating=none"], "parameters: found 'gate', expected at least one number"),
    ],
)
def test_what_cannot_be_tuned_is_refused_in_one_line(names: list[str], overrides: list[str], message: str) -> None:
    with pytest.raises(ScenarioError, match=message) as refused:
        tunable_parameters.select_parameters(rpojax.load("inspection", overrides), names)
    assert "\n" not in str(refused.value)


def test_weights_of_the_formation_are_tuned_where_a_phase_has_none_of_its_own() -> None:
    file = rpojax.load("safety_ellipse")
    assert "formation.position_weight[0]" in tunable_parameters.select_parameters(file, ["formation"]).names
    tables = file.model_dump(mode="json")
    for phase in tables["phases"]:
        phase["position_weight"] = [1.0, 1.0, 1.0]
    with pytest.raises(ScenarioError, match=r"formation.position_weight: found 'phases, which have weights"):
        tunable_parameters.select_parameters(schema.ScenarioFile.model_validate(tables), ["formation"])


def test_a_dispersed_number_is_not_tuned() -> None:
    entry = {"key": "navigation.edge_noise_px", "kind": "normal", "sigma": 0.1}
    tables = INSPECTION.model_dump()
    dispersed = schema.ScenarioFile.model_validate({**tables, "dispersions": [*tables["dispersions"], entry]})
    with pytest.raises(ScenarioError, match=r"navigation.edge_noise_px: found 'a dispersion of it'"):
        tunable_parameters.select_parameters(dispersed, ["navigation"])


def gate_of_its_own(estimate: Any, **others: Any) -> Any:
    return rpojax.Stages().call("orbit_update", estimate=estimate, **others)


def test_a_number_that_a_replaced_stage_may_read_can_be_tuned() -> None:
    overrides = ["navigation.gating=none"]
    with pytest.raises(ScenarioError, match="without which it has no effect"):
        tunable_parameters.select_parameters(rpojax.load("inspection", overrides), ["navigation.gate_sigma"])
    stages = rpojax.Stages(orbit_update=gate_of_its_own)
    with forgotten_plugins():
        file = rpojax.load("inspection", overrides, plugin=rpojax.Plugin(stages=stages))
        chosen = tunable_parameters.select_parameters(file, ["navigation.gate_sigma"])
    assert chosen.names == ["navigation.gate_sigma"]
    given = tunable_parameters.select_parameters(
        rpojax.load("inspection", overrides), ["navigation.gate_sigma"], stages.replaced
    )
    assert given.names == chosen.names
