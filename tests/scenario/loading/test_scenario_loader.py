"""Scenario files, packaged and of the user: what loads, and what is refused."""

import shutil
from pathlib import Path

import pytest
from scenario_error_assertions import assert_one_line
from scenario_variants import TABLE, with_sections, write_with_table

from rpojax.errors import ScenarioError
from rpojax.scenario.dispersed_numbers import dispersion_keys
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings
from rpojax.vision.surface import landmark_file


@pytest.mark.parametrize("name", scenario_loader.packaged_names())
def test_every_packaged_scenario_loads_and_has_the_name_of_its_file(name: str) -> None:
    file = scenario_loader.load(name)
    assert file.name == name
    assert file.description
    static = static_settings(file, allow_team=True)
    assert static.ticks * static.tick_s == pytest.approx(file.duration_s)


def test_the_nominal_scenario_and_its_variants_are_packaged() -> None:
    variants = {"inspection_cold", "inspection_full", "inspection_eclipse", "inspection_faults"}
    assert {"inspection", *variants} <= set(scenario_loader.packaged_names())


def test_a_file_extends_a_file_that_extends_a_packaged_scenario(tmp_path: Path) -> None:
    (tmp_path / "grand").mkdir()
    (tmp_path / "grand" / "parent.toml").write_text('extends = "inspection"\n[servicer]\nmass_kg = 40.0\n')
    child = tmp_path / "child.toml"
    child.write_text('extends = "grand/parent.toml"\nname = "child"\n[thruster]\nforce_n = 0.05\n')
    file = scenario_loader.load(child)
    base = scenario_loader.load("inspection")
    assert (file.name, file.servicer.mass_kg, file.thruster.force_n) == ("child", 40.0, 0.05)
    assert file.servicer.inertia_kg_m2 == base.servicer.inertia_kg_m2
    assert file.navigation == base.navigation


@pytest.mark.parametrize(
    "source", ["inspektion", "no/such/file.toml", "."], ids=["a misspelt name", "a missing file", "a folder"]
)
def test_the_error_of_an_unknown_scenario_lists_the_packaged_ones(source: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load(source)
    assert_one_line(caught.value, "scenario", "inspection", "vbar_approach")
    assert source in str(caught.value)


def test_a_misspelt_file_is_answered_with_the_one_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "debris.toml").write_text('extends = "inspection"\nname = "debris"\n')
    with pytest.raises(ScenarioError, match=r"did you mean 'debris\.toml'"):
        scenario_loader.load(tmp_path / "debris.tml")
    with pytest.raises(ScenarioError) as unlike:
        scenario_loader.load(tmp_path / "quite_another_mission.toml")
    assert "did you mean" not in str(unlike.value)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ScenarioError, match=r"did you mean 'debris\.toml'"):
        scenario_loader.load("debis.toml")


def test_a_byte_order_mark_is_skipped(tmp_path: Path) -> None:
    path = tmp_path / "marked.toml"
    path.write_text('extends = "inspection"\nname = "marked"\n', encoding="utf-8-sig")
    assert scenario_loader.load(path).name == "marked"


def test_invalid_toml_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "broken.toml"
    path.write_text("name = \n")
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load(path)
    assert_one_line(caught.value, str(path), "valid TOML")


def test_a_binary_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "image.toml"
    path.write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load(path)
    assert_one_line(caught.value, "scenario", "a TOML file in UTF-8")


@pytest.mark.parametrize("extends", ['"self.toml"', "3", '"nowhere"'], ids=["itself", "a number", "nothing"])
def test_a_chain_of_extends_without_an_end_is_refused(tmp_path: Path, extends: str) -> None:
    path = tmp_path / "self.toml"
    path.write_text(f"extends = {extends}\n")
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load(path)
    assert_one_line(caught.value, "scenario" if "nowhere" in extends else "extends")


def test_paths_of_trained_files_are_relative_to_the_scenario_file(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('extends = "inspection"\n[imaging]\nfield = "my.field.safetensors"\n')
    file = scenario_loader.load(tmp_path / "mine.toml")
    assert Path(file.imaging.field) == (tmp_path / "my.field.safetensors").resolve()
    shutil.copy(landmark_file.landmark_path(None), tmp_path / "my.landmarks.safetensors")
    (tmp_path / "mine.toml").write_text('extends = "inspection"\n[camera]\nlandmarks = "my.landmarks.safetensors"\n')
    file = scenario_loader.load(tmp_path / "mine.toml")
    assert Path(file.camera.landmarks) == (tmp_path / "my.landmarks.safetensors").resolve()


def test_a_case_table_becomes_part_of_the_scenario(tmp_path: Path) -> None:
    file = scenario_loader.load(write_with_table(tmp_path, TABLE))
    values = {
        "gps.noise_m": [1.5, 2.0],
        "formation.desired_position_m[1]": [-30.0, -25.0],
        "faults.fault.kind": ["none", "gps_outage"],
    }
    assert file.design.model_dump() == {"kind": "table", "file": "", "values": values}
    assert dispersion_keys.varied_keys(file)[-3:] == [
        "gps.noise_m",
        "formation.desired_position_m",
        "faults.fault.kind",
    ]
    (tmp_path / "runs.csv").unlink()
    again = scenario_loader.validate(file.model_dump(mode="json"))
    assert again == file
    assert scenario_digest(again) == scenario_digest(file)


def test_a_spreadsheet_export_in_another_folder_is_read(tmp_path: Path) -> None:
    (tmp_path / "deeper").mkdir()
    (tmp_path / "deeper" / "excel.csv").write_bytes(b'\xef\xbb\xbf"gps.noise_m"\r\n1\r\n2\r\n')
    path = write_with_table(tmp_path, TABLE, 'kind = "table"\nfile = "deeper/excel.csv"\n')
    assert scenario_loader.load(path).design.model_dump()["values"] == {"gps.noise_m": [1.0, 2.0]}
    other = scenario_loader.load(path, [f"design.file={tmp_path / 'runs.csv'}"])
    assert len(other.design.model_dump()["values"]) == 3


def test_a_case_table_is_read_only_by_load(inspection_file: ScenarioFile, tmp_path: Path) -> None:
    """A recorded scenario, such as that of a campaign, cannot make the program read a file."""
    (tmp_path / "runs.csv").write_text(TABLE)
    with pytest.raises(ScenarioError, match=r"^design.file"):
        with_sections(inspection_file, design={"kind": "table", "file": str(tmp_path / "runs.csv")})
    both = 'kind = "table"\nfile = "runs.csv"\n[design.values]\n"gps.noise_m" = [1.0]\n'
    with pytest.raises(ScenarioError, match=r"^design.file: found .*expected no file beside values"):
        scenario_loader.load(write_with_table(tmp_path, TABLE, both))
    for values in ({}, {"gps.noise_m": []}, {"gps.noise_m": [1.0], "gps.bias_sigma_m": [1.0, 2.0]}):
        with pytest.raises(ScenarioError, match=r"^design.values"):
            with_sections(inspection_file, design={"kind": "table", "values": values})
