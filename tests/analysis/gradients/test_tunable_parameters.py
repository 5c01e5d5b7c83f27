"""What can be tuned, in which coordinates, and what is refused."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rpojax
from rpojax.analysis.gradients import gradient_descent, tunable_parameters
from rpojax.analysis.gradients.tunable_parameters import GROUPS, TUNABLE, Coordinate, LogCoordinate, LogitCoordinate
from rpojax.errors import ScenarioError
from rpojax.scenario import params, schema

INSPECTION = rpojax.load("inspection")


@given(st.floats(1e-6, 1e6), st.sampled_from([LogCoordinate(), LogitCoordinate(-1e-9, 2e6)]))
def test_a_coordinate_leads_back_to_its_value(value: float, coordinate: Coordinate) -> None:
    there = coordinate.to_coordinate(np.asarray([value]))
    np.testing.assert_allclose(coordinate.from_coordinate(jnp.asarray(there)), [value], rtol=1e-9)


@given(st.floats(-30.0, 30.0))
def test_every_coordinate_is_an_allowed_value(x: float) -> None:
    assert float(LogCoordinate().from_coordinate(jnp.asarray(x))) > 0.0
    assert 0.2 < float(LogitCoordinate(0.2, 3.0).from_coordinate(jnp.asarray(0.5 * x))) < 3.0


@pytest.mark.parametrize("key", TUNABLE)
def test_every_tunable_key_is_a_number_of_flight_software(key: str) -> None:
    path, _ = params.leaf_path_and_factor(key)
    assert path[0] == "flight"
    assert schema.nominal_value(INSPECTION, key) is not None


@pytest.mark.parametrize("group", GROUPS)
def test_the_start_of_a_group_is_the_scenario_as_it_is(group: str) -> None:
    chosen = tunable_parameters.select_parameters(INSPECTION, [group])
    assert len(chosen.names) == chosen.count == len(chosen.initial)
    for key, value in chosen.values(jnp.asarray(chosen.initial)).items():
        np.testing.assert_allclose(value, schema.nominal_value(INSPECTION, key), rtol=1e-12)


def test_a_weight_of_zero_is_held_in_its_group() -> None:
    assert tunable_parameters.select_parameters(INSPECTION, ["formation"]).held_fixed == ("formation.velocity_weight",)


@pytest.mark.parametrize("x", [-50.0, -1.0, 50.0])
def test_however_far_a_walk_goes_its_look_away_fits_between_two_decisions(x: float) -> None:
    chosen = tunable_parameters.select_parameters(INSPECTION, ["formation.lead_s"])
    lead = float(chosen.values(jnp.asarray([x]))["formation.lead_s"])
    schema_file = gradient_descent.tuned_scenario(INSPECTION, {"formation.lead_s": lead})
    assert schema_file.formation.lead_s == lead


def test_words_may_overlap() -> None:
    both = tunable_parameters.select_parameters(INSPECTION, ["navigation", "navigation.edge_noise_px"])
    assert list(both.nominal) == list(GROUPS["navigation"])


@pytest.mark.parametrize(
    ("words", "overrides", "message"),
    [
        (["navigate"], [], "--parameters: found 'navigate', expected one of navigation, gate, formation,"),
        (["servicer.mass_kg"], [], "--parameters: found 'servicer.mass_kg'"),
        (["formation.velocity_weight"], [], r"formation.velocity_weight: found \[0.0, 0.0, 0.0\], expected a positive"),
        (["gate"], ["navigation.gate_sigma=15"], "--parameters: found 'gate', expected at least one number"),
        (["navigation.gate_sigma"], ["navigation.gate_sigma=15"], "found 15.0, expected a start between 1.5 and 12"),
    ],
)
def test_what_cannot_be_tuned_is_refused_in_one_line(words: list[str], overrides: list[str], message: str) -> None:
    with pytest.raises(ScenarioError, match=message) as refused:
        tunable_parameters.select_parameters(rpojax.load("inspection", overrides), words)
    assert "\n" not in str(refused.value)


def test_a_dispersed_number_is_not_tuned() -> None:
    entry = {"key": "navigation.edge_noise_px", "kind": "normal", "sigma": 0.1}
    tables = INSPECTION.model_dump()
    dispersed = schema.ScenarioFile.model_validate({**tables, "dispersions": [*tables["dispersions"], entry]})
    with pytest.raises(ScenarioError, match=r"navigation.edge_noise_px: found 'a dispersion of it'"):
        tunable_parameters.select_parameters(dispersed, ["navigation"])
