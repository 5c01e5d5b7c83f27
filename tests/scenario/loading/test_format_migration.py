"""Format versions of scenario files: older ones are migrated with a line, newer ones refused."""

import copy
import warnings
from pathlib import Path

import numpy as np
import pytest

import rpojax
from rpojax.cli import main
from rpojax.errors import ScenarioError
from rpojax.scenario import former_fault
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.loading.format_migration import FormatChangeWarning
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import FORMAT_VERSION

OLD = """extends = "inspection"
name = "old"
[navigation]
confirm_frames = 3
confirm_tolerance_px = 4.0
rejections_before_recovery = 10
"""


def test_a_file_of_the_first_version_is_migrated_with_a_line_that_says_what_changed(tmp_path: Path) -> None:
    (tmp_path / "old.toml").write_text(OLD)
    with pytest.warns(FormatChangeWarning, match=r"navigation\.confirm_frames = 3 became confirm_within_s = 3") as told:
        file = rpojax.load(tmp_path / "old.toml")
    assert len(told) == 1
    assert "\n" not in str(told[0].message)
    found = file.navigation
    assert (found.confirm_within_s, found.recovery_after_s) == (3.0, 10.0)
    # A pixel of the packaged camera, 128 over 10 deg, is 0.0783 deg in the middle.
    np.testing.assert_allclose(found.confirm_tolerance_deg_s, 4.0 * 0.0783243, rtol=1e-5)


def test_frames_become_seconds_at_the_rate_of_the_camera(tmp_path: Path) -> None:
    (tmp_path / "old.toml").write_text(OLD + "[rates]\nplant_hz = 10.0\ncamera_hz = 2.0\n")
    with pytest.warns(FormatChangeWarning, match="at 2 Hz"):
        found = rpojax.load(tmp_path / "old.toml").navigation
    assert (found.confirm_within_s, found.recovery_after_s) == (1.5, 5.0)
    np.testing.assert_allclose(found.confirm_tolerance_deg_s, 8.0 * 0.0783243, rtol=1e-5)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize(("width_px", "field_of_view_deg"), [(128, 10.0), (512, 10.0), (2048, 4.0)])
def test_a_tolerance_in_pixels_becomes_the_angle_of_that_many_pixels_of_the_camera(
    version: int, width_px: int, field_of_view_deg: float, tmp_path: Path
) -> None:
    camera = f"[camera]\nwidth_px = {width_px}\nheight_px = {width_px}\nfield_of_view_deg = {field_of_view_deg}\n"
    head = f'extends = "inspection"\nname = "old"\nformat_version = {version}\n'
    (tmp_path / "old.toml").write_text(head + "[navigation]\nconfirm_tolerance_px_s = 5.0\n" + camera)
    with pytest.warns(FormatChangeWarning, match=r"confirm_tolerance_px_s = 5 became confirm_tolerance_deg_s"):
        found = rpojax.load(tmp_path / "old.toml")
    # Five pixels beside the middle of the image.
    focal = 0.5 * width_px / np.tan(np.radians(0.5 * field_of_view_deg))
    np.testing.assert_allclose(found.navigation.confirm_tolerance_deg_s, np.degrees(5.0 / focal), rtol=1e-12)


def test_a_finer_camera_has_the_tolerance_of_the_file_that_it_extends(tmp_path: Path) -> None:
    (tmp_path / "fine.toml").write_text('extends = "inspection"\nname = "fine"\n[camera]\nwidth_px = 512\n')
    found, base = (rpojax.load(each).navigation for each in (tmp_path / "fine.toml", "inspection"))
    assert found.confirm_tolerance_deg_s == base.confirm_tolerance_deg_s


def test_a_file_without_former_keys_is_read_without_a_word(tmp_path: Path) -> None:
    (tmp_path / "new.toml").write_text('extends = "inspection"\nname = "new"\n')
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        file = rpojax.load(tmp_path / "new.toml")
    assert file.format_version == FORMAT_VERSION
    assert scenario_digest(file) == scenario_digest(rpojax.load("inspection"))


@pytest.mark.parametrize("version", [1, 2])
def test_faults_of_an_older_file_keep_the_pressure_sensor(tmp_path: Path, version: int) -> None:
    (tmp_path / "old.toml").write_text(
        f'format_version = {version}\nextends = "inspection"\nname = "old"\n[effects]\nfaults = true\n'
    )
    expected = (
        f"format {version} read as 4: chamber_pressure.enabled = true was added, which effects.faults = true meant"
    )
    with pytest.warns(FormatChangeWarning, match=expected):
        assert rpojax.load(tmp_path / "old.toml").chamber_pressure.enabled


@pytest.mark.parametrize(
    ("text", "enabled"),
    [
        ('format_version = 3\nextends = "inspection"\n[effects]\nfaults = true\n', False),
        ('extends = "inspection"\n[effects]\nfaults = true\n[chamber_pressure]\nenabled = false\n', False),
        ('extends = "inspection_faults"\n[effects]\nfaults = true\n', True),
        ('extends = "inspection"\n[effects]\nfaults = false\n', False),
    ],
)
def test_what_a_file_says_of_the_pressure_sensor_stays(tmp_path: Path, text: str, enabled: bool) -> None:
    (tmp_path / "new.toml").write_text(f'name = "new"\n{text}')
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert rpojax.load(tmp_path / "new.toml").chamber_pressure.enabled is enabled


@pytest.mark.parametrize("version", [0, 5, "2", True, 2.0])
def test_another_version_is_refused(tmp_path: Path, version: object) -> None:
    text = str(version).lower() if isinstance(version, bool) else repr(version)
    (tmp_path / "a.toml").write_text(f'extends = "inspection"\nname = "a"\nformat_version = {text}\n')
    with pytest.raises(ScenarioError, match=r"format_version: found .* a version from 1 to 4"):
        rpojax.load(tmp_path / "a.toml")


def test_a_former_key_in_a_file_of_the_present_version_or_beside_its_successor_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(f"format_version = {FORMAT_VERSION}\n" + OLD)
    with pytest.raises(ScenarioError, match=r"navigation.confirm_frames"):
        rpojax.load(tmp_path / "a.toml")
    (tmp_path / "b.toml").write_text(OLD + "confirm_within_s = 2.0\n")
    with pytest.raises(ScenarioError, match="it or confirm_within_s, not both"):
        rpojax.load(tmp_path / "b.toml")


def test_the_command_line_says_what_changed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "old.toml").write_text(OLD)
    assert main.main(["validate", str(tmp_path / "old.toml")]) == 0
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1
    assert told[0].startswith(f"rpojax: {tmp_path / 'old.toml'}: format 1 read as 4: navigation.confirm_frames")


@pytest.mark.parametrize("base", scenario_loader.packaged_names())
def test_a_new_file_is_the_scenario_that_it_extends(
    base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main.main(["new", "mine", "--extends", base]) == 0
    assert capsys.readouterr().out == "mine.toml\n"
    assert scenario_digest(rpojax.load("mine.toml")) == scenario_digest(rpojax.load(base))


def test_every_line_that_a_new_file_comments_out_is_a_key_with_its_value(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    main.main(["new", "mine"])
    lines = Path("mine.toml").read_text().splitlines()
    opened = [line.removeprefix("# ") if " = " in line or line.startswith("# [[") else line for line in lines]
    text = "\n".join(line for line in opened if 'kind = "none"' not in line)
    Path("mine.toml").write_text(text)
    file, base = rpojax.load("mine.toml"), rpojax.load("inspection")
    assert [each.metric for each in file.requirements] == ["min_range_m"]
    assert file.orbit == base.orbit
    assert file.camera == base.camera
    assert any(each.key == "gps.noise_m" and each.kind == "uniform" for each in file.dispersions)


def test_a_new_file_does_not_replace_one_and_has_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.toml").write_text("mine")
    for words, expected in (
        (["mine"], "exists already"),
        (["../mine"], "found '../mine'"),
        (["inspection"], "a name that no packaged scenario has"),
        (["other", "--extends", "nothing"], "a packaged scenario"),
    ):
        assert main.main(["new", *words]) == 2
        assert expected in capsys.readouterr().err
    assert Path("mine.toml").read_text() == "mine"


def test_the_schema_of_partial_files_requires_nothing_and_knows_what_is_extended(
    capsys: pytest.CaptureFixture[str],
) -> None:
    import json

    assert main.main(["schema", "--partial"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert "extends" in content["properties"]
    assert all("required" not in each for each in (content, *content["$defs"].values()))


FORMER = """
format_version = 3
extends = "inspection_faults"
name = "old"
[fault]
duration_s = 900.0
[[dispersions]]
key = "fault.severity"
kind = "uniform"
low = 0.1
high = 0.2
"""


def test_one_fault_of_an_older_file_is_a_list_of_it_with_the_same_random_numbers(tmp_path: Path) -> None:
    (tmp_path / "old.toml").write_text(FORMER)
    with pytest.warns(FormatChangeWarning, match=r"\[fault\] became \[\[faults\]\] with name = 'fault'"):
        file = scenario_loader.load(tmp_path / "old.toml")
    (fault,) = file.faults
    assert (fault.name, fault.kind, fault.duration_s, fault.severity) == ("fault", "none", 900.0, 0.5)
    assert "faults.fault.severity" in {entry.name for entry in file.dispersions}
    assert former_fault.former_name("faults.fault.severity+faults.fault.wheel") == "fault.severity+fault.wheel"
    assert former_fault.former_name("faults.other.severity") == "faults.other.severity"


def test_the_fault_of_a_servicer_and_of_a_recorded_scenario_are_read(tmp_path: Path) -> None:
    tables = scenario_loader.load("cooperative_faults").model_dump(mode="json")
    present = copy.deepcopy(tables)
    (fault,) = tables.pop("faults")
    tables["fault"] = {key: value for key, value in fault.items() if key != "name"}
    tables["servicers"][1]["fault"] = tables["servicers"][1].pop("faults")["fault"]
    tables["format_version"] = 3
    found = scenario_loader.validate_recorded(tables)
    assert found == scenario_loader.validate(present)
    assert scenario_digest(found) == scenario_digest(scenario_loader.validate(present))


def test_faults_under_new_names_change_the_digest() -> None:
    one = ["effects.faults=true", "faults.a.kind=gps_outage"]
    digests = {
        scenario_digest(scenario_loader.load("inspection", settings))
        for settings in (one, [*one, "faults.a.start_s=5"], [*one, "faults.b.kind=none"], one[:1])
    }
    assert len(digests) == 4
