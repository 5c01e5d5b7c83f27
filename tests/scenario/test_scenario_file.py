"""Scenario files: what loads, what is refused and how it says so, and where every number ends up."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy_reference import axis_angle_quaternion, random_unit, rotation_matrix, unit
from pydantic import BaseModel

from rpojax.errors import ScenarioError, UnknownKeyError
from rpojax.physics import equipment_faults
from rpojax.physics.plant_options import Effects
from rpojax.scenario import params as parameters
from rpojax.scenario.loading import scenario_loader as scenarios
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings


@pytest.fixture
def tables(inspection_file: ScenarioFile) -> dict[str, Any]:
    """The nominal scenario as nested tables, free to be spoilt."""
    return inspection_file.model_dump()


# What loads


@pytest.mark.parametrize("name", scenarios.packaged_names())
def test_every_packaged_scenario_loads_and_is_named_after_its_file(name: str) -> None:
    file = scenarios.load(name)
    assert file.name == name
    assert file.description
    static = static_settings(file)
    assert static.ticks * static.tick_s == pytest.approx(file.duration_s)


def test_the_nominal_scenario_and_its_variants_are_packaged() -> None:
    variants = {"inspection_cold", "inspection_full", "inspection_eclipse", "inspection_faults"}
    assert {"inspection", *variants} <= set(scenarios.packaged_names())


def test_switches_of_the_plant_and_of_the_filter_are_static_settings() -> None:
    nominal = static_settings(scenarios.load("inspection"))
    assert nominal.effects == Effects()
    plant = ["effects.drag=true", "effects.integrator=rk8", "effects.zonal_degree=6", "effects.faults=true"]
    onboard = ["navigation.zonal_degree=4", "navigation.luni_solar=true"]
    changed = static_settings(scenarios.load("inspection", [*plant, *onboard]))
    assert changed.effects == Effects(drag=True, integrator="rk8", zonal_degree=6, faults=True)
    assert (changed.navigation_zonal_degree, changed.navigation_luni_solar) == (4, True)
    assert (nominal.navigation_zonal_degree, nominal.navigation_luni_solar) == (2, False)
    assert hash(changed) != hash(nominal)


def test_the_full_scenario_has_every_effect_but_faults_which_another_adds() -> None:
    full, faulty = (static_settings(scenarios.load(f"inspection_{name}")).effects for name in ("full", "faults"))
    assert {name for name, value in vars(full).items() if value is False} == {"faults"}
    assert full.zonal_degree == 6
    assert faulty == replace(full, faults=True)


@pytest.mark.parametrize(
    ("utc", "days"),
    [
        ("2000-01-01T12:00:00", 0.0),
        ("2000-01-02T12:00", 1.0),
        ("2026-03-20T14:46:00", 9575.0 + 2.0 / 24.0 + 46.0 / 1440.0),
        ("2026-03-20T15:46:00+01:00", 9575.0 + 2.0 / 24.0 + 46.0 / 1440.0),
        ("2026-03-20", 9574.5),
    ],
)
def test_an_epoch_is_seconds_of_terrestrial_time_from_noon_of_the_first_day_of_2000(utc: str, days: float) -> None:
    for written in (f'"{utc}"', utc):  # as text, and as the date that TOML knows
        static = static_settings(scenarios.load("inspection", [f"epoch_utc={written}"]))
        # 37 leap seconds by 2017 and 32.184 s between atomic and terrestrial time.
        assert static.epoch_s == pytest.approx(days * 86400.0 + 69.184, abs=1e-6)


def test_dispersions_of_a_file_join_those_of_its_base_and_replace_those_of_the_same_key(tmp_path: Path) -> None:
    path = tmp_path / "child.toml"
    path.write_text(
        'extends = "inspection"\nname = "child"\n'
        '[[dispersions]]\nkey = "servicer.mass_kg"\nkind = "uniform"\nlow = 29.0\nhigh = 31.0\n'
        '[[dispersions]]\nkey = "gps.noise_m"\nkind = "normal"\nsigma = 0.1\n'
    )
    before = {drawn.key: drawn for drawn in scenarios.load("inspection").dispersions}
    after = {drawn.key: drawn for drawn in scenarios.load(path).dispersions}
    assert set(after) == set(before) | {"gps.noise_m"}
    assert (before["servicer.mass_kg"].kind, after["servicer.mass_kg"].kind) == ("normal", "uniform")
    assert {key for key in before if after[key] != before[key]} == {"servicer.mass_kg"}


def test_static_settings_are_whole_numbers_of_ticks_and_steps() -> None:
    file = scenarios.load(
        "inspection",
        ["rates.camera_hz=2.0", "rates.plant_hz=10.0", "rates.formation_period_s=150.0", "duration_s=900.0"],
    )
    static = static_settings(file)
    assert (static.ticks, static.substeps, static.formation_ticks) == (1800, 5, 300)
    assert (static.tick_s, static.step_s, static.formation_period_s) == (0.5, 0.1, 150.0)


def test_an_override_changes_its_key_and_nothing_else(inspection_file: ScenarioFile) -> None:
    before = inspection_file.model_dump()
    after = scenarios.load("inspection", ["servicer.mass_kg = 31.5", "navigation.gating=none"]).model_dump()
    assert after["servicer"].pop("mass_kg") == 31.5
    assert after["navigation"].pop("gating") == "none"
    before["servicer"].pop("mass_kg")
    before["navigation"].pop("gating")
    assert after == before


def test_a_chain_of_files_each_changing_a_key_ends_in_the_packaged_scenario(tmp_path: Path) -> None:
    (tmp_path / "grand").mkdir()
    (tmp_path / "grand" / "parent.toml").write_text('extends = "inspection"\n[servicer]\nmass_kg = 40.0\n')
    child = tmp_path / "child.toml"
    child.write_text('extends = "grand/parent.toml"\nname = "child"\n[thruster]\nforce_n = 0.05\n')
    file = scenarios.load(child)
    base = scenarios.load("inspection")
    assert (file.name, file.servicer.mass_kg, file.thruster.force_n) == ("child", 40.0, 0.05)
    assert file.servicer.inertia_kg_m2 == base.servicer.inertia_kg_m2
    assert file.navigation == base.navigation


def test_the_cold_start_is_the_nominal_mission_with_a_worse_hand_over() -> None:
    warm, cold = scenarios.load("inspection").model_dump(), scenarios.load("inspection_cold").model_dump()
    differing = {key for key in warm["navigation"] if warm["navigation"][key] != cold["navigation"][key]}
    assert differing == {"initial_relative_position_sigma_m", "initial_relative_velocity_sigma_m_s"}
    assert {key for key in warm if warm[key] != cold[key]} == {"name", "description", "navigation"}


def test_the_digest_follows_the_numbers_and_not_the_words(inspection_file: ScenarioFile) -> None:
    digest = scenario_digest(inspection_file)
    assert scenario_digest(scenarios.load("inspection", ["description=another"])) == digest
    assert scenario_digest(scenarios.load("inspection", ["gps.noise_m=2.5"])) != digest


# What is refused


def assert_one_line(error: ScenarioError, key: str, *words: str) -> None:
    """Checks that the message is one line that starts with the key's path and names what was expected."""
    message = str(error)
    assert "\n" not in message
    assert message.startswith(f"{key}: found ")
    assert ", expected " in message
    expected = message.split(", expected ", 1)[1]
    for word in words:
        assert word in expected, message


BAD_VALUES = {
    "negative mass": ("servicer.mass_kg=-1.0", "servicer.mass_kg", "greater than 0"),
    "zero mass": ("servicer.mass_kg=0.0", "servicer.mass_kg", "greater than 0"),
    "nan": ("servicer.mass_kg=nan", "servicer.mass_kg", "finite"),
    "infinite": ("gps.noise_m=inf", "gps.noise_m", "finite"),
    "nan in a vector": ("initial.relative_position_m=[0.0, nan, 0.0]", "initial.relative_position_m.1", "finite"),
    "a word for a number": ("servicer.mass_kg=heavy", "servicer.mass_kg", "number"),
    "a quoted number": ('servicer.mass_kg="30.0"', "servicer.mass_kg", "number"),
    "a flag for a number": ("thruster.force_n=true", "thruster.force_n", "number"),
    "a number for a vector": ("wheels.inertia_kg_m2=0.1", "wheels.inertia_kg_m2", "list"),
    "a fraction for a whole number": ("camera.width_px=128.5", "camera.width_px", "integer"),
    "a list for a section": ("servicer=[1.0]", "servicer", "a table"),
    "a vector too short": ("initial.relative_position_m=[0.0, -50.0]", "initial.relative_position_m", "3"),
    "a vector too long": ("wheels.torque_limit_n_m=[0.1, 0.1, 0.1, 0.1]", "wheels.torque_limit_n_m", "3"),
    "a quaternion too short": ("target.attitude=[1.0, 0.0, 0.0]", "target.attitude", "4"),
    "a matrix with two rows": (
        "servicer.inertia_kg_m2=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]", "servicer.inertia_kg_m2", "3"
    ),
    "a hull of three points": (
        "target.hull_m=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]", "target.hull_m", "4"
    ),
    "zero quaternion": ("target.attitude=[0.0, 0.0, 0.0, 0.0]", "target.attitude", "not zero"),
    "zero direction": ("thruster.direction=[0.0, 0.0, 0.0]", "thruster.direction", "not zero"),
    "indefinite inertia": (
        "servicer.inertia_kg_m2=[[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
        "servicer.inertia_kg_m2",
        "positive definite",
    ),
    "asymmetric inertia": (
        "servicer.inertia_kg_m2=[[1.0, 0.2, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]",
        "servicer.inertia_kg_m2",
        "symmetric",
    ),
    "inertia of no real body": (
        "target.inertia_kg_m2=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 3.0]]", "target.inertia_kg_m2", "real body"
    ),
    "wheels in a plane": (
        "wheels.axes=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0]]", "wheels.axes", "span"
    ),
    "wheel axes of no unit length": (
        "wheels.axes=[[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]", "wheels.axes", "unit"
    ),
    "hyperbolic orbit": ("orbit.eccentricity=1.2", "orbit.eccentricity", "less than"),
    "orbit under the ground": ("orbit.semi_major_axis_m=6e6", "orbit.semi_major_axis_m", "greater than"),
    "probability above one": ("camera.miss_probability=1.5", "camera.miss_probability", "less than or equal to 1"),
    "unknown camera": ("camera.model=thermal", "camera.model", "'geometric'"),
    "an epoch that is no date": ("epoch_utc=tomorrow", "epoch_utc", "date and time", "2026-03-20T14:46:00"),
    "an epoch with a thirteenth month": ('epoch_utc="2026-13-20T14:46:00"', "epoch_utc", "date and time"),
    "an epoch that is a number": ("epoch_utc=2026", "epoch_utc", "string"),
    "a zonal degree of one": ("effects.zonal_degree=1", "effects.zonal_degree", "0, 2"),
    "a zonal degree beyond the model": ("navigation.zonal_degree=7", "navigation.zonal_degree", "0, 2"),
    "a number for a switch": ("effects.drag=1", "effects.drag", "boolean"),
    "an unknown integrator": ("effects.integrator=euler", "effects.integrator", "'rk4'", "'rk8'"),
    "an unknown fault": ("fault.kind=gremlins", "fault.kind", "'none'", "'gps_outage'"),
    "a fourth wheel": ("fault.wheel=3", "fault.wheel", "0, 1 or 2"),
    "air without a scale": ("atmosphere.scale_height_m=0.0", "atmosphere.scale_height_m", "greater than 0"),
    "unknown gating": ("navigation.gating=maybe", "navigation.gating", "'covariance'", "'none'"),
    "plant slower than the camera": ("rates.plant_hz=0.5", "rates.plant_hz", "whole multiple of rates.camera_hz"),
    "plant rate that does not divide": ("rates.plant_hz=5.5", "rates.plant_hz", "whole multiple of rates.camera_hz"),
    "burn period that does not divide": (
        "rates.formation_period_s=200.3", "rates.formation_period_s", "whole number of camera periods"
    ),
    "duration that does not divide": ("duration_s=6000.5", "duration_s", "whole number of camera periods"),
    "outliers with sizes in the wrong order": (
        "camera.outlier_size_min_px=100.0", "camera.outlier_size_min_px", "camera.outlier_size_max_px"
    ),
    "looking away longer than a burn period": (
        "pointing.look_away_limit_s=500.0", "pointing.look_away_limit_s", "rates.formation_period_s"
    ),
    "a lead shorter than half a look-away": ("formation.lead_s=54.9", "formation.lead_s", "55 to 145"),
    "a look-away that runs into the next decision": ("formation.lead_s=145.1", "formation.lead_s", "55 to 145"),
    "a ratio beyond all numbers": ("rates.camera_hz=1e-308", "rates.plant_hz", "whole multiple of rates.camera_hz"),
    "a number of ticks beyond all numbers": ("rates.camera_hz=5e-324", "rates.plant_hz", "whole multiple"),
    "a plant too fast for any machine": ("rates.plant_hz=1001.0", "rates.plant_hz", "less than or equal to 1000"),
    "a place inside the keep-out sphere": (
        "formation.desired_position_m=[6.0, -8.0, 0.0]", "formation.desired_position_m", "limits.keep_out_m = 10"
    ),
    "a perigee in the atmosphere": ("orbit.eccentricity=0.06", "orbit.eccentricity", "perigee above 6.47e+06 m"),
    "a direction of rounding errors": ("thruster.direction=[1e-9, -9e-7, 0.0]", "thruster.direction", "not zero"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_VALUES.values(), ids=BAD_VALUES.keys())
def test_a_bad_value_is_refused_in_one_line_with_its_key_and_what_was_expected(case: tuple[str, ...]) -> None:
    override, key, *words = case
    with pytest.raises(ScenarioError) as caught:
        scenarios.load("inspection", [override])
    assert caught.value.key == key
    assert_one_line(caught.value, key, *words)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("servicer.mas_kg=30.0", ("'mass_kg'",)),
        ("servicer.shoe_size=43.0", ("a key of the scenario",)),
        ("sevicer.mass_kg=30.0", ("a key of the scenario",)),
        ("servicer.mass_kg.unit=30.0", ("a key of the scenario",)),
        ("servicer.mass_kg", ("KEY=VALUE",)),
        ("=30.0", ("KEY=VALUE",)),
        ("servicer.mass_kg=", ("KEY=VALUE",)),
    ],
)
def test_an_override_without_a_known_key_or_a_value_is_refused(override: str, words: tuple[str, ...]) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenarios.load("inspection", [override])
    assert_one_line(caught.value, "--set", *words)
    assert override.partition("=")[0] in str(caught.value)


@pytest.mark.parametrize(
    ("section", "misspelt", "meant"),
    [("servicer", "mas_kg", "mass_kg"), ("navigation", "gate_sigmas", "gate_sigma"), (None, "servicr", "servicer")],
)
def test_a_misspelt_key_in_a_file_is_refused_with_the_one_that_was_meant(
    tables: dict[str, Any], section: str | None, misspelt: str, meant: str
) -> None:
    (tables[section] if section else tables)[misspelt] = 1.0
    with pytest.raises(ScenarioError) as caught:
        scenarios.validate(tables)
    key = f"{section}.{misspelt}" if section else misspelt
    assert isinstance(caught.value, UnknownKeyError)
    assert caught.value.key == key
    assert str(caught.value) == f"{key}: unknown key (did you mean {meant!r}?)"


@pytest.mark.parametrize("key", ["servicer.mass_kg", "camera", "duration_s"])
def test_a_missing_key_is_refused_by_name(tables: dict[str, Any], key: str) -> None:
    section, _, name = key.partition(".")
    if name:
        del tables[section][name]
    else:
        del tables[section]
    with pytest.raises(ScenarioError) as caught:
        scenarios.validate(tables)
    assert_one_line(caught.value, key, "a value")


BAD_DISPERSIONS: dict[str, tuple[dict[str, Any], str, tuple[str, ...]]] = {
    "key that does not exist": (
        {"key": "servicer.colour", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "section that does not exist": (
        {"key": "chaser.mass_kg", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "key that is no number": (
        {"key": "camera.model", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "key that sets the program's shape": (
        {"key": "camera.width_px", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "a rate": ({"key": "rates.plant_hz", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)),
    "unknown kind": ({"key": "gps.noise_m", "kind": "cauchy", "sigma": 1.0}, "dispersions.0", ("'normal'",)),
    "negative sigma": (
        {"key": "gps.noise_m", "kind": "normal", "sigma": -1.0}, "dispersions.0.sigma", ("greater than or equal to 0",)
    ),
    "negative sigma of a component": (
        {"key": "thruster.position_m", "kind": "normal", "sigma": [0.0, -1.0, 0.0]},
        "dispersions.0.sigma.1",
        ("greater than or equal to 0",),
    ),
    "negative sigma of a rotation": (
        {"key": "target.attitude", "kind": "small_rotation", "sigma_deg": -1.0},
        "dispersions.0.sigma_deg",
        ("greater than or equal to 0",),
    ),
    "a word for a key": (
        {"key": 3, "kind": "direction"}, "dispersions.0.key", ("string",)
    ),
    "misspelt name": (
        {"key": "gps.noise_m", "kind": "normal", "sigmas": 1.0}, "dispersions.0.sigma", ("a value",)
    ),
    "sigma of the wrong shape": (
        {"key": "thruster.position_m", "kind": "normal", "sigma": [1.0, 1.0]}, "dispersions.0.sigma", ("(3,)",)
    ),
    "bounds in the wrong order": (
        {"key": "gps.noise_m", "kind": "uniform", "low": 2.0, "high": 1.0}, "dispersions.0", ("low at most high",)
    ),
    "an attitude for a vector": (
        {"key": "target.tumble_axis", "kind": "attitude"}, "dispersions.0.kind", ("4 components",)
    ),
    "a direction for a quaternion": (
        {"key": "target.attitude", "kind": "direction"}, "dispersions.0.kind", ("3 components",)
    ),
    "a kind of fault by number": (
        {"key": "fault.kind", "kind": "choice", "values": [1.0, 2.0]}, "dispersions.0.values", ("kinds of fault",)
    ),
    "names for a number": (
        {"key": "fault.severity", "kind": "choice", "values": ["gps_outage"]}, "dispersions.0.values", ("numbers",)
    ),
    "a kind of fault that is no choice": (
        {"key": "fault.kind", "kind": "uniform", "low": 0.0, "high": 7.0}, "dispersions.0.kind", ("'choice'",)
    ),
    "a switch of the plant": (
        {"key": "effects.drag", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "what the filter knows": (
        {"key": "navigation.zonal_degree", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "choices of the wrong shape": (
        {"key": "gps.noise_m", "kind": "choice", "values": [[1.0, 2.0]]}, "dispersions.0.values", ("shape ()",)
    ),
    "log-normal of a vector with zeros": (
        {"key": "initial.relative_position_m", "kind": "log_normal", "sigma": 0.1}, "dispersions.0.key", ("above zero",)
    ),
}  # fmt: skip


BAD_DRAWS: dict[str, tuple[dict[str, Any], str, tuple[str, ...]]] = {
    "a mass that may be negative": (
        {"key": "servicer.mass_kg", "kind": "uniform", "low": -1.0, "high": 30.0},
        "dispersions.0.low", ("servicer.mass_kg", "greater than 0"),
    ),
    "a probability that may exceed one": (
        {"key": "camera.miss_probability", "kind": "uniform", "low": 0.5, "high": 1.5},
        "dispersions.0.high", ("less than or equal to 1",),
    ),
    "components that may be negative": (
        {"key": "wheels.torque_limit_n_m", "kind": "uniform", "low": -0.1, "high": 0.1},
        "dispersions.0.low", ("greater than 0",),
    ),
    "one mass of several that is none": (
        {"key": "servicer.mass_kg", "kind": "choice", "values": [30.0, 0.0]},
        "dispersions.0.values", ("greater than 0",),
    ),
    "one direction of several that is none": (
        {"key": "target.tumble_axis", "kind": "choice", "values": [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]},
        "dispersions.0.values", ("not zero",),
    ),
}  # fmt: skip
BAD_DISPERSIONS |= BAD_DRAWS


def test_a_uniform_may_end_where_all_components_at_once_would_be_no_direction(tables: dict[str, Any]) -> None:
    tables["dispersions"] = [{"key": "target.tumble_axis", "kind": "uniform", "low": 0.0, "high": 1.0}]
    assert scenarios.validate(tables).dispersions[0].key == "target.tumble_axis"


@pytest.mark.parametrize("case", BAD_DISPERSIONS.values(), ids=BAD_DISPERSIONS.keys())
def test_a_bad_dispersion_is_refused_with_its_place_in_the_list(
    tables: dict[str, Any], case: tuple[dict[str, Any], str, tuple[str, ...]]
) -> None:
    dispersion, key, words = case
    tables["dispersions"] = [dispersion]
    with pytest.raises(ScenarioError) as caught:
        scenarios.validate(tables)
    assert_one_line(caught.value, key, *words)


GOOD_REQUIREMENT: dict[str, Any] = {
    "metric": "min_range_m", "bound": "at least", "limit": 15.0, "probability": 0.99, "consumer_risk": 0.1
}  # fmt: skip

BAD_REQUIREMENTS: dict[str, tuple[dict[str, Any], str, tuple[str, ...]]] = {
    "an unknown metric": ({"metric": "colour"}, "metric", ("name of a metric", "'formation_error_rms_m'")),
    "a misspelt metric": ({"metric": "min_rang_m"}, "metric", ("did you mean 'min_range_m'?",)),
    "an unknown bound": ({"bound": "about"}, "bound", ("'at most'", "'at least'")),
    "no number for a limit": ({"limit": float("nan")}, "limit", ("finite",)),
    "a sure thing": ({"probability": 1.0}, "probability", ("less than 1",)),
    "a probability of nothing": ({"probability": 0.0}, "probability", ("greater than 0",)),
    "no risk": ({"consumer_risk": 0.0}, "consumer_risk", ("greater than 0",)),
    "a confidence for a risk": ({"consumer_risk": 0.9}, "consumer_risk", ("less than 0.5",)),
}


@pytest.mark.parametrize("case", BAD_REQUIREMENTS.values(), ids=BAD_REQUIREMENTS.keys())
def test_a_bad_requirement_is_refused_with_its_place_in_the_list(
    tables: dict[str, Any], case: tuple[dict[str, Any], str, tuple[str, ...]]
) -> None:
    change, key, words = case
    tables["requirements"] = [GOOD_REQUIREMENT, GOOD_REQUIREMENT | change]
    with pytest.raises(ScenarioError) as caught:
        scenarios.validate(tables)
    assert_one_line(caught.value, f"requirements.1.{key}", *words)


def test_a_misspelt_key_of_a_requirement_is_refused_with_the_one_that_was_meant(tables: dict[str, Any]) -> None:
    tables["requirements"] = [GOOD_REQUIREMENT | {"limits": 3.0}]
    with pytest.raises(UnknownKeyError) as caught:
        scenarios.validate(tables)
    assert str(caught.value) == "requirements.0.limits: unknown key (did you mean 'limit'?)"


def test_a_scenario_without_requirements_is_one_with_none_and_has_the_same_digest(tables: dict[str, Any]) -> None:
    asked_for = scenarios.validate(tables)
    assert asked_for.requirements
    del tables["requirements"]
    older = scenarios.validate(tables)
    assert older.requirements == []
    assert scenario_digest(older) == scenario_digest(asked_for)
    assert static_settings(older) == static_settings(asked_for)


def test_the_digest_is_what_it_was_before_there_were_requirements_designs_and_precisions(
    inspection_file: ScenarioFile,
) -> None:
    content = inspection_file.model_dump(mode="json")
    for key in ("name", "description", "requirements", "tuning", "design", "precision"):
        del content[key]
    text = json.dumps(content, sort_keys=True)
    assert scenario_digest(inspection_file) == hashlib.sha256(text.encode()).hexdigest()
    single = inspection_file.model_copy(update={"precision": "single"})
    assert scenario_digest(single) != scenario_digest(inspection_file)


def test_requirements_of_a_file_replace_those_of_its_base(tmp_path: Path) -> None:
    path = tmp_path / "child.toml"
    path.write_text(
        'extends = "inspection"\n[[requirements]]\nmetric = "delta_v_m_s"\nbound = "at most"\nlimit = 0.5\n'
        "probability = 0.9\nconsumer_risk = 0.2\n"
    )
    assert [wanted.metric for wanted in scenarios.load(path).requirements] == ["delta_v_m_s"]
    assert scenarios.load("inspection", ["requirements=[]"]).requirements == []


def test_limits_of_the_mission_keep_clear_of_what_the_scenario_itself_forbids(inspection_file: ScenarioFile) -> None:
    limits = {wanted.metric: wanted.limit for wanted in inspection_file.requirements}
    assert limits["min_range_m"] > inspection_file.limits.keep_out_m
    assert limits["look_away_peak_s"] == inspection_file.pointing.look_away_limit_s


def test_two_dispersions_of_one_key_are_refused(tables: dict[str, Any]) -> None:
    tables["dispersions"] = [{"key": "gps.noise_m", "kind": "normal", "sigma": 0.1}] * 2
    with pytest.raises(ScenarioError) as caught:
        scenarios.validate(tables)
    assert_one_line(caught.value, "dispersions.1.key", "no other dispersion")


@pytest.mark.parametrize(
    "source", ["inspektion", "no/such/file.toml", "."], ids=["a misspelt name", "a missing file", "a folder"]
)
def test_an_unknown_scenario_is_refused_with_the_names_of_the_packaged_ones(source: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(source)
    assert_one_line(caught.value, "scenario", "inspection", "inspection_cold")
    assert source in str(caught.value)


def test_a_file_may_begin_with_the_mark_that_some_editors_put_first(tmp_path: Path) -> None:
    path = tmp_path / "marked.toml"
    path.write_text('extends = "inspection"\nname = "marked"\n', encoding="utf-8-sig")
    assert scenarios.load(path).name == "marked"


def test_a_file_that_is_no_toml_is_refused_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "broken.toml"
    path.write_text("name = \n")
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(path)
    assert_one_line(caught.value, str(path), "valid TOML")


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "image.toml"
    path.write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(path)
    assert_one_line(caught.value, "scenario", "readable TOML")


@pytest.mark.parametrize("extends", ['"self.toml"', "3", '"nowhere"'], ids=["itself", "a number", "nothing"])
def test_a_chain_that_does_not_end_in_a_scenario_is_refused(tmp_path: Path, extends: str) -> None:
    path = tmp_path / "self.toml"
    path.write_text(f"extends = {extends}\n")
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(path)
    assert_one_line(caught.value, "scenario" if "nowhere" in extends else "extends")


# Where the numbers end up


STATIC = {
    "field",
    "detector",
    "statistics",
    "sky_seed",
    "model",
    "width_px",
    "height_px",
    "gating",
    "zonal_degree",
    "luni_solar",
}
"""Keys that shape the compiled program instead of being data."""


def numeric_keys() -> list[str]:
    """Every key of every section that holds data, from the schema alone."""
    keys = []
    for name, field in ScenarioFile.model_fields.items():
        section = field.annotation
        if name not in ("rates", "effects", "tuning") and isinstance(section, type) and issubclass(section, BaseModel):
            keys += [f"{name}.{key}" for key in section.model_fields if key not in STATIC]
    return keys


def factor(key: str) -> float:
    """What a key's unit is in SI, read from the words of the key."""
    words = key.partition(".")[2].split("_")
    named = {"deg": np.pi / 180.0, "mrad": 1e-3, "mm": 1e-3}
    return next((named[word] for word in words if word in named), 1.0)


@pytest.mark.parametrize("key", numeric_keys())
def test_every_number_of_the_scenario_lands_in_the_params_in_si_units(
    inspection_file: ScenarioFile, inspection_params: Params, key: str
) -> None:
    section, _, name = key.partition(".")
    value = getattr(getattr(inspection_file, section), name)
    value = np.asarray(equipment_faults.KINDS.index(value) if key == "fault.kind" else value, dtype=float)
    path, found_factor = parameters.leaf_path_and_factor(key)
    leaf = np.asarray(parameters.get_leaf(inspection_params, path))
    assert found_factor == pytest.approx(factor(key), rel=1e-15)
    assert leaf.dtype == np.float64
    np.testing.assert_allclose(leaf, value * factor(key), rtol=1e-15)


def test_no_number_is_forgotten_or_shared() -> None:
    paths = [parameters.leaf_path_and_factor(key)[0] for key in numeric_keys()]
    assert len(paths) > 90
    assert len(set(paths)) == len(paths)


@pytest.mark.parametrize(
    "key", ["servicer.mass", "servicer.mass_g", "camera.width_px", "rates.plant_hz", "mass_kg", ""]
)
def test_a_key_that_is_no_number_of_the_scenario_has_no_place_in_the_params(key: str) -> None:
    if key == "servicer.mass":
        assert parameters.leaf_path_and_factor(key) == (
            ("plant", "servicer", "mass"),
            1.0,
        )  # the leaf's own name is its SI name
        return
    with pytest.raises(ScenarioError):
        parameters.leaf_path_and_factor(key)


def test_putting_a_value_changes_that_leaf_only(inspection_params: Params) -> None:
    path = ("flight", "navigation", "gate_sigma")
    changed = parameters.replace_leaf(inspection_params, path, parameters.get_leaf(inspection_params, path) + 1.0)
    assert float(parameters.get_leaf(changed, path)) == float(parameters.get_leaf(inspection_params, path)) + 1.0
    assert changed.flight.navigation.edge_noise is inspection_params.flight.navigation.edge_noise
    assert changed.plant is inspection_params.plant


def test_flight_software_is_told_the_nominal_vehicle(inspection_file: ScenarioFile, inspection_params: Params) -> None:
    onboard, camera = inspection_params.flight.vehicle, inspection_file.camera
    assert float(onboard.mass) == inspection_file.servicer.mass_kg
    assert float(onboard.thrust) == inspection_file.thruster.force_n
    np.testing.assert_allclose(np.linalg.norm(onboard.thrust_direction), 1.0, rtol=1e-15)
    half_angle = np.deg2rad(0.5 * camera.field_of_view_deg)
    np.testing.assert_allclose(onboard.focal_px, 0.5 * camera.width_px / np.tan(half_angle), rtol=1e-14)


# The filter's idea of the target's size, from the hull


def log_sizes(hull: np.ndarray, attitudes: np.ndarray) -> np.ndarray:
    """Log of the geometric mean side [m] of the outline's box from afar, for rotation matrices (..., 3, 3)."""
    seen = np.einsum("...ij,nj->...ni", attitudes, hull)
    sides = seen.max(axis=-2) - seen.min(axis=-2)
    return 0.5 * np.log(sides[..., 0] * sides[..., 1])


def test_the_filters_target_size_is_the_mean_size_of_the_hull_over_all_attitudes(inspection_file: ScenarioFile) -> None:
    rng = np.random.default_rng(1)
    attitudes = np.array([rotation_matrix(random_unit(rng, 4)) for _ in range(4000)])
    sizes = log_sizes(np.array(inspection_file.target.hull_m), attitudes)
    # Four sigma of the mean of 4000 logs with a spread of 0.15.
    np.testing.assert_allclose(np.exp(sizes.mean()), inspection_file.navigation.target_size_m, rtol=0.01)
    total = np.linalg.norm(inspection_file.navigation.scale_sigma)
    np.testing.assert_allclose(sizes.std(), total, rtol=0.1)


def test_the_filters_size_errors_are_those_of_a_tumble_and_of_where_its_axis_points(
    inspection_file: ScenarioFile,
) -> None:
    rng = np.random.default_rng(2)
    hull = np.array(inspection_file.target.hull_m)
    means, spreads = [], []
    for _ in range(300):
        # A tumble about an axis fixed in the target, seen from one side.
        axis, start = unit(rng.normal(size=3)), rotation_matrix(random_unit(rng, 4))
        angles = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
        sizes = log_sizes(
            hull, np.array([start @ rotation_matrix(axis_angle_quaternion(axis, angle)) for angle in angles])
        )
        means.append(sizes.mean())
        spreads.append(sizes.var())
    slow, fast = inspection_file.navigation.scale_sigma
    # Four sigma of a standard deviation from 300 draws are 16 per cent.
    np.testing.assert_allclose(np.std(means), slow, rtol=0.2)
    np.testing.assert_allclose(np.sqrt(np.mean(spreads)), fast, rtol=0.2)
