"""A key is not set in vain where a dispersion or a design replaces its value in every run."""

from pathlib import Path

import pytest
from scenario_error_assertions import assert_one_line
from scenario_variants import write_with_table

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader

RATE = "target.tumble_rate_deg_s"
STATION = "formation.desired_position_m"


def write(folder: Path, name: str, base: str, text: str) -> Path:
    """Writes a scenario that extends another one."""
    path = folder / name
    path.write_text(f'extends = "{base}"\n{text}')
    return path


@pytest.mark.parametrize(
    ("override", "kind"),
    [
        (f"{RATE}=5.0", "uniform"),
        ("target.tumble_axis=[0.0, 0.0, 1.0]", "direction"),
        ("target.attitude=[1.0, 0.0, 0.0, 0.0]", "attitude"),
    ],
)
def test_an_override_of_a_key_that_a_dispersion_replaces_is_refused(override: str, kind: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load("inspection", [override])
    key = override.partition("=")[0]
    assert_one_line(caught.value, "overrides", key, f"the {kind} dispersion", f"dispersions.{key}=none")


def test_an_override_that_an_earlier_one_replaces_is_refused() -> None:
    with pytest.raises(ScenarioError, match="choice dispersion"):
        scenario_loader.load("inspection", ["gps.noise_m=1.0", "dispersions.gps.noise_m={kind='choice', values=[2.0]}"])


@pytest.mark.parametrize(
    "key", ["servicer.mass_kg=31.0", "thruster.force_scale=1.1", "initial.relative_position_m=[0.0, -40.0, 0.0]"]
)
def test_a_nominal_value_about_which_a_dispersion_draws_may_be_set(key: str) -> None:
    assert len(scenario_loader.load("inspection", [key]).dispersions) == len(
        scenario_loader.load("inspection").dispersions
    )


def test_a_dispersion_is_removed_changed_replaced_or_added_by_an_override() -> None:
    fixed = scenario_loader.load("inspection", [f"{RATE}=5.0", f"dispersions.{RATE}=none"])
    assert fixed.target.tumble_rate_deg_s == 5.0
    assert RATE not in [entry.name for entry in fixed.dispersions]
    changes = [f"dispersions.{RATE}.high=5.0", "dispersions.servicer.mass_kg={kind='uniform', low=29.0, high=31.0}"]
    both = "initial.relative_velocity_m_s+gps.noise_m"
    covariance = "[[1e-4,0,0,0],[0,1e-4,0,0],[0,0,1e-4,0],[0,0,0,0.01]]".replace("0,", "0.0,").replace("0]", "0.0]")
    added = [
        "dispersions.target.scale={kind='log_normal', sigma=0.1}",
        "dispersions.initial.relative_velocity_m_s=none",
    ]
    joint = f"dispersions.{both}={{kind='correlated_normal', covariance={covariance}}}"
    found = {entry.name: entry for entry in scenario_loader.load("inspection", [*changes, *added, joint]).dispersions}
    assert (found[RATE].low, found[RATE].high) == (0.8, 5.0)
    assert found["servicer.mass_kg"].kind == "uniform"
    assert found["target.scale"].sigma == 0.1
    assert found[both].keys == both.split("+")


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("dispersions.target.tumble_rate=none", "did you mean 'target.tumble_rate_deg_s'?"),
        (f"dispersions.{RATE}.hihg=5.0", "one of its settings"),
        (f"dispersions.{RATE}=5.0", "'none', or a table"),
    ],
)
def test_an_override_of_no_dispersion_is_refused(override: str, words: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load("inspection", [override])
    assert_one_line(caught.value, "overrides", words)


def test_a_file_does_not_set_a_key_that_the_base_replaces(tmp_path: Path) -> None:
    child = write(tmp_path, "child.toml", "inspection", "[target]\ntumble_rate_deg_s = 5.0\n")
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load(child)
    assert_one_line(caught.value, RATE, "the uniform dispersion", "in the base", 'kind = "none"')
    removal = f'[[dispersions]]\nkey = "{RATE}"\nkind = "none"\n'
    grandchild = scenario_loader.load(write(tmp_path, "next.toml", "child.toml", removal))
    assert grandchild.target.tumble_rate_deg_s == 5.0
    assert RATE not in [entry.name for entry in grandchild.dispersions]
    own = (
        f'[target]\ntumble_rate_deg_s = 2.0\n[[dispersions]]\nkey = "{RATE}"\nkind = "uniform"\nlow = 1.0\nhigh = 3.0\n'
    )
    assert scenario_loader.load(write(tmp_path, "own.toml", "inspection", own)).target.tumble_rate_deg_s == 2.0


def test_only_a_dispersion_of_the_base_can_be_removed(tmp_path: Path) -> None:
    child = write(tmp_path, "child.toml", "inspection", '[[dispersions]]\nkey = "target.tumble_rate"\nkind = "none"\n')
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load(child)
    assert_one_line(caught.value, "dispersions", "target.tumble_rate_deg_s")


def test_a_component_that_a_table_lists_is_not_set_but_the_others_are(tmp_path: Path) -> None:
    table = write_with_table(tmp_path, f"{STATION}[1]\n-20.0\n-25.0\n")
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load(table, [f"{STATION}=[0.0, -40.0, 0.0]"])
    assert_one_line(caught.value, "overrides", "the table of the design", "design={kind='independent'}")
    assert scenario_loader.load(table, [f"{STATION}=[1.0, -30.0, 0.0]"]).formation.desired_position_m[0] == 1.0
    alone = scenario_loader.load(table, [f"{STATION}=[0.0, -40.0, 0.0]", "design={kind='independent'}"])
    assert alone.formation.desired_position_m[1] == -40.0


def test_a_dispersion_of_a_component_replaces_that_component(tmp_path: Path) -> None:
    dispersion = f"dispersions.{STATION}[1]={{kind='uniform', low=-40.0, high=-30.0}}"
    assert scenario_loader.load("inspection", [dispersion, f"{STATION}=[5.0, -30.0, 0.0]"])
    with pytest.raises(ScenarioError, match=r"dispersions\.formation\.desired_position_m\[1\]=none"):
        scenario_loader.load("inspection", [dispersion, f"{STATION}=[0.0, -20.0, 0.0]"])


def test_derived_values_replace_the_nominal_one() -> None:
    derived = "dispersions.gps.noise_m={kind='derived', offset=1.0, terms=[{key='gps.bias_sigma_m', factor=1.0}]}"
    with pytest.raises(ScenarioError, match="the derived dispersion"):
        scenario_loader.load("inspection", [derived, "gps.noise_m=3.0"])
