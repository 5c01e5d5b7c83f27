"""What `rpojax show` prints: value, unit, origin and meaning of each key of a scenario."""

import json
from pathlib import Path

import pytest

from rpojax.cli import main
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.loading.shown_keys import shown_keys


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    text = 'extends = "vbar_approach"\nname = "mine"\n[camera]\nfield_of_view_deg = 20.0\n'
    (tmp_path / "mine.toml").write_text(text)
    return "mine.toml"


def test_a_key_says_its_file_and_what_it_replaces(mine: str) -> None:
    (lens,) = shown_keys(scenario_loader.read(mine), "camera.field_of_view_deg")
    assert (lens.value, lens.unit, lens.origin, lens.before) == (20.0, "deg", mine, (15.0, "vbar_approach"))
    assert "field of view" in lens.meaning
    origins = {each.key: each.origin for each in shown_keys(scenario_loader.read(mine, ["gps.noise_m=3.0"]))}
    assert origins["gps.noise_m"] == "--set"
    assert origins["camera.width_px"] == "vbar_approach"
    assert origins["rates.camera_hz"] == "inspection"
    assert origins["mission.abort_margin_m"] == "default"
    assert origins["phases.approach.reference.max_speed_m_s"] == "vbar_approach"
    assert origins["dispersions.servicer.mass_kg"] == "inspection"


@pytest.fixture
def replaced(tmp_path: Path) -> Path:
    """A scenario with phases, requirements and a design of its own, on one that has a design, too."""
    base = tmp_path / "base.toml"
    base.write_text('extends = "vbar_approach"\n[design]\nkind = "sobol"\n')
    text = """extends = "base.toml"
        [[phases]]
        name = "approach"
        reference = { kind = "hold", position_m = [0.0, -50.0, 0.0] }
        [[requirements]]
        metric = "min_range_m"
        bound = "at least"
        limit = 20.0
        probability = 0.9
        consumer_risk = 0.1
        [design]
        kind = "table"
        file = "cases.csv"
        [[dispersions]]
        key = "servicer.mass_kg"
        kind = "none"
        """
    (tmp_path / "cases.csv").write_text("servicer.mass_kg\n29.0\n31.0\n")
    path = tmp_path / "replaced.toml"
    path.write_text(text)
    return path


def test_what_a_later_file_leaves_out_of_a_list_that_it_replaces_is_a_default(replaced: Path) -> None:
    reading = scenario_loader.read(replaced, ["phases.approach.on_timeout=abort"])
    keys = {each.key: each for each in shown_keys(reading)}
    assert (keys["phases.approach.pointing"].origin, keys["phases.approach.passively_safe"].origin) == ("default",) * 2
    assert (keys["phases.approach.on_timeout"].origin, keys["phases.approach.on_timeout"].before) == ("--set", None)
    (unset,) = shown_keys(scenario_loader.read(replaced), "phases.approach.on_timeout")
    assert (unset.value, unset.origin) == ("hold", "default")
    requirement = keys["requirements.0"]
    assert (requirement.origin, requirement.before) == (str(replaced), None)


def test_a_table_design_says_its_file_and_that_its_values_are_from_it(replaced: Path) -> None:
    keys = {each.key: each for each in shown_keys(scenario_loader.read(replaced), "design")}
    table = str(replaced.with_name("cases.csv"))
    assert (keys["design.file"].value, keys["design.file"].origin) == (table, str(replaced))
    values = keys["design.values"]
    assert (values.value, values.origin, values.before) == ({"servicer.mass_kg": [29.0, 31.0]}, table, None)
    assert keys["design.kind"].before is None


def test_a_dispersion_that_an_override_changes_is_from_it() -> None:
    key = "dispersions.servicer.mass_kg"
    (changed,) = shown_keys(scenario_loader.read("inspection", [f"{key}.sigma=1.5"]), key)
    assert changed.origin == "--set"
    assert changed.before is not None
    assert changed.before[1] == "inspection"
    (kept,) = shown_keys(scenario_loader.read("inspection", ["gps.noise_m=3.0"]), key)
    assert (kept.origin, kept.before) == ("inspection", None)


@pytest.mark.parametrize(
    "key",
    ["phases.hold_100.corridor", "phases.hold_100.corridor.width_m", "phases.approach.until.time_s", "goal.phase"],
)
def test_a_key_that_may_be_left_out_is_not_given(key: str, capsys: pytest.CaptureFixture[str]) -> None:
    reading = scenario_loader.read("vbar_approach")
    assert [(each.value, each.origin) for each in shown_keys(reading, key)] == [(None, "default")]
    assert main.main(["show", "vbar_approach", key]) == 0
    assert capsys.readouterr().out.startswith(f"{key} = not given\n  from: default\n")


def test_of_a_section_whose_keys_are_all_left_out_each_is_told() -> None:
    found = shown_keys(scenario_loader.read("vbar_approach"), "goal")
    assert [(each.key, each.value) for each in found] == [("goal.phase", None), ("goal.at", None)]


def _chain(folder: Path, *texts: str) -> Path:
    """The last of files each of which extends the one before."""
    for number, text in enumerate(texts):
        extends = "" if number == 0 else f'extends = "{number - 1}.toml"\n'
        (folder / f"{number}.toml").write_text(extends + text)
    return folder / f"{len(texts) - 1}.toml"


def test_what_a_thruster_of_a_later_list_leaves_out_is_a_default(tmp_path: Path) -> None:
    thrusters = scenario_loader.read("final_approach").tables["thrusters"]
    kept = ("name", "position_m", "direction", "force_n", "isp_s")
    parts = ["[[thrusters]]\n" + "".join(f"{key} = {json.dumps(each[key])}\n" for key in kept) for each in thrusters]
    path = _chain(tmp_path, 'extends = "final_approach"\n', "\n".join(parts))
    origins = {each.key: (each.value, each.origin, each.before) for each in shown_keys(scenario_loader.read(path))}
    assert origins["thrusters.t01.minimum_on_s"] == (0.0, "default", None)
    assert origins["thrusters.t01.force_n"] == (0.25, str(path), None)


def test_a_dispersion_that_a_file_removed_is_replaced_by_none(tmp_path: Path) -> None:
    entry, key = '[[dispersions]]\nkey = "servicer.mass_kg"\nkind = ', "dispersions.servicer.mass_kg"
    path = _chain(tmp_path, f'extends = "inspection"\n{entry}"none"\n', f'{entry}"normal"\nsigma = 1.0\n')
    (shown,) = shown_keys(scenario_loader.read(path), key)
    assert (shown.origin, shown.before) == (str(path), None)


def test_keys_of_a_table_that_files_share_each_have_an_origin(tmp_path: Path) -> None:
    path = _chain(
        tmp_path,
        'extends = "vbar_approach"\n[tuning.metrics]\ndelta_v_m_s = 0.5\n',
        "[tuning.metrics]\nformation_error_rms_m = 0.7\n",
    )
    found = {each.key: Path(each.origin).name for each in shown_keys(scenario_loader.read(path), "tuning.metrics")}
    assert found == {"tuning.metrics.delta_v_m_s": "0.toml", "tuning.metrics.formation_error_rms_m": "1.toml"}


def test_a_table_set_as_a_whole_leaves_nothing_of_the_one_before(tmp_path: Path) -> None:
    table = '[design]\nkind = "grid"\n[design.values]\n"servicer.mass_kg" = [29.0, 31.0]\n'
    none = '[[dispersions]]\nkey = "servicer.mass_kg"\nkind = "none"\n'
    path = _chain(tmp_path, f'extends = "inspection"\n{table}{none}')
    reading = scenario_loader.read(path, ["design={kind='sobol'}"])
    assert [(each.key, each.origin) for each in shown_keys(reading, "design")] == [("design.kind", "--set")]


@pytest.mark.parametrize(
    ("scenario", "key", "shown"),
    [
        ("vbar_approach", "phases.0.control_period_s", "phases.hold_100.control_period_s = 140.0 s\n  from: vbar_app"),
        ("thruster_failure", "thrusters.11.force_n", "thrusters.t12.force_n = 0.25 N\n  from: final_approach"),
        ("cooperative_inspection", "servicers.0.servicer.mass_kg", "servicers.first.servicer.mass_kg = not given\n"),
        (
            "cooperative_inspection",
            "servicers.third.phases.inspect.reference.radial_phase_deg",
            "servicers.third.phases.inspect.reference.radial_phase_deg = 180.0 deg\n  from: cooperative_inspection",
        ),
    ],
)
def test_a_part_of_a_list_is_found_by_name_or_number(
    scenario: str, key: str, shown: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(["show", scenario, key]) == 0
    assert capsys.readouterr().out.startswith(shown)


@pytest.mark.parametrize("name", scenario_loader.packaged_names())
def test_every_key_of_the_packaged_scenarios_has_a_meaning(name: str) -> None:
    lists = {"phases", "servicers", "thrusters", "requirements", "dispersions"}
    found = [each.key for each in shown_keys(scenario_loader.read(name)) if not each.meaning]
    assert [key for key in found if key not in lists and not key.startswith("servicers.")] == []


def test_a_dispersed_key_and_one_without_effect_say_so() -> None:
    keys = {each.key: each for each in shown_keys(scenario_loader.read("inspection"))}
    assert keys["servicer.mass_kg"].varied_by == "normal dispersion"
    assert keys["atmosphere.density_kg_m3"].needs


def test_the_command_prints_one_key_a_section_and_json(mine: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["show", mine, "camera.field_of_view_deg"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["camera.field_of_view_deg = 20.0 deg", f"  from: {mine}, in place of 15.0 of vbar_approach"]
    assert main.main(["show", mine, "phases"]) == 0
    assert "[phases.approach.until]" in capsys.readouterr().out
    assert main.main(["show", mine, "rates", "--json"]) == 0
    assert [each["unit"] for each in json.loads(capsys.readouterr().out)["keys"]] == ["Hz", "Hz", "s", "s"]


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("camara.field_of_view_deg", "did you mean 'camera.field_of_view_deg'?"),
        ("camrea", "did you mean 'camera'?"),
        ("mass_kg", "did you mean"),
        ("qqq", "expected a key or section"),
        ("phases.approach.corridr", "did you mean"),
        ("link.rate_m", "unknown key"),
        ("phases.3.control", "unknown key"),
    ],
)
def test_an_unknown_key_gets_the_nearest_one(key: str, hint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["show", "inspection", key]) == 2
    error = capsys.readouterr().err
    assert hint in error
    assert error.count("\n") == 1
