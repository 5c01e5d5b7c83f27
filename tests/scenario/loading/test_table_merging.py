"""Overrides by `KEY=VALUE`, and files merged into the scenario that they extend."""

from pathlib import Path

import pytest
from scenario_error_assertions import assert_one_line
from scenario_variants import TABLE, write_with_table

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


def test_dispersions_are_added_to_those_of_the_base_or_replace_those_of_the_same_key(tmp_path: Path) -> None:
    path = tmp_path / "child.toml"
    path.write_text(
        'extends = "inspection"\nname = "child"\n'
        '[[dispersions]]\nkey = "servicer.mass_kg"\nkind = "uniform"\nlow = 29.0\nhigh = 31.0\n'
        '[[dispersions]]\nkey = "gps.noise_m"\nkind = "normal"\nsigma = 0.1\n'
    )
    before = {entry.key: entry for entry in scenario_loader.load("inspection").dispersions}
    after = {entry.key: entry for entry in scenario_loader.load(path).dispersions}
    assert set(after) == set(before) | {"gps.noise_m"}
    assert (before["servicer.mass_kg"].kind, after["servicer.mass_kg"].kind) == ("normal", "uniform")
    assert {key for key in before if after[key] != before[key]} == {"servicer.mass_kg"}


def test_an_override_changes_its_key_only(inspection_file: ScenarioFile) -> None:
    before = inspection_file.model_dump()
    after = scenario_loader.load("inspection", ["servicer.mass_kg = 31.5", "navigation.gating=none"]).model_dump()
    assert after["servicer"].pop("mass_kg") == 31.5
    assert after["navigation"].pop("gating") == "none"
    before["servicer"].pop("mass_kg")
    before["navigation"].pop("gating")
    assert after == before


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("servicer.mas_kg=30.0", ("'servicer.mass_kg'",)),
        ("servicer.shoe_size=43.0", ("a key of the scenario",)),
        ("sevicer.mass_kg=30.0", ("a key of the scenario",)),
        ("servicer.mass_kg.unit=30.0", ("a key of the scenario",)),
        ("servicer.mass_kg", ("KEY=VALUE",)),
        ("=30.0", ("KEY=VALUE",)),
        ("servicer.mass_kg=", ("KEY=VALUE",)),
    ],
)
def test_an_override_without_known_key_or_value_is_refused(override: str, words: tuple[str, ...]) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load("inspection", [override])
    assert_one_line(caught.value, "overrides", *words)
    assert override.partition("=")[0] in str(caught.value)


def test_requirements_replace_those_of_the_base(tmp_path: Path) -> None:
    path = tmp_path / "child.toml"
    path.write_text(
        'extends = "inspection"\n[[requirements]]\nmetric = "delta_v_m_s"\nbound = "at most"\nlimit = 0.5\n'
        "probability = 0.9\nconsumer_risk = 0.2\n"
    )
    assert [wanted.metric for wanted in scenario_loader.load(path).requirements] == ["delta_v_m_s"]
    assert scenario_loader.load("inspection", ["requirements=[]"]).requirements == []


def test_a_design_replaces_that_of_the_base(tmp_path: Path) -> None:
    base = write_with_table(tmp_path, TABLE)
    (tmp_path / "next.toml").write_text(f'extends = "{base.name}"\n[design]\nkind = "sobol"\n')
    assert scenario_loader.load(tmp_path / "next.toml").design.kind == "sobol"
    assert scenario_loader.load("inspection", ["design.kind=latin_hypercube"]).design.kind == "latin_hypercube"


def test_correlated_dispersions_replace_those_of_the_same_keys_only(tmp_path: Path) -> None:
    head = '[[dispersions]]\nkind = "correlated_normal"\n'
    base, more = tmp_path / "base.toml", tmp_path / "more.toml"
    base.write_text(
        f'extends = "inspection"\n{head}keys = ["gps.noise_m"]\ncovariance = [[1.0]]\n'
        f'{head}keys = ["gps.bias_sigma_m"]\ncovariance = [[1.0]]\n'
    )
    more.write_text(f'extends = "base.toml"\n{head}keys = ["gps.noise_m"]\ncovariance = [[4.0]]\n')
    found = {entry.name: entry for entry in scenario_loader.load(more).dispersions}
    assert found["gps.noise_m"].model_dump()["covariance"] == [[4.0]]
    assert "gps.bias_sigma_m" in found
    assert len(found) == len(scenario_loader.load(base).dispersions)
