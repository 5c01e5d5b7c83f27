"""Warnings before the runs on the command line: shown and listed, without effect on the exit status."""

import json
from pathlib import Path

import pytest
from command_line_calls import Call

import rpojax
from rpojax.cli.scenario_files import show_unused_keys

NOISY = ("--set", "gps.noise_m=20.0")
WARNING = "navigation.gps_noise_m: the filter believes 2, the truth is 20"


def test_validate_shows_and_lists_warnings(call: Call) -> None:
    assert call("validate", "inspection", "--json").json["warnings"] == []
    noisy = call("validate", "inspection", *NOISY)
    assert (noisy.status, noisy.err) == (0, "")
    assert noisy.out.splitlines()[1].startswith(f"warning: {WARNING}")
    (listed,) = call("validate", "inspection", *NOISY, "--json").json["warnings"]
    assert listed.startswith(WARNING)


def test_a_dry_run_shows_and_lists_warnings(call: Call) -> None:
    words = ("campaign", "inspection", "--runs", 2, "--block-size", 2, "--dry-run", "--set", "dispersions=[]", *NOISY)
    people, machines = call(*words), call(*words, "--json")
    assert (people.status, machines.status) == (0, 0)
    assert any(line.startswith(f"warning: {WARNING}") for line in people.out.splitlines())
    assert [each.startswith(WARNING) for each in machines.json["warnings"]] == [True]


def test_a_run_warns_on_stderr_first_and_in_its_report(call: Call, tmp_path: Path) -> None:
    out = tmp_path / "run"
    words = ("run", "inspection", "--no-film", "--set", "duration_s=400", *NOISY)
    result = call(*words, "--out", out)
    assert result.err.splitlines()[0].startswith(f"rpojax: warning: {WARNING}")
    assert result.status == 0
    (listed,) = json.loads((out / "report.json").read_text())["warnings"]
    assert listed.startswith(WARNING)
    page = (out / "report.html").read_text()
    assert page.index("the filter believes 2, the truth is 20") < page.index('<section id="identity">')


def test_a_key_without_effect_is_named_before_anything_is_simulated(
    call: Call, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = "faults.gps.kind: found 'gps_outage', which has no effect, expected effects.faults = true beside it"
    mine = tmp_path / "mine.toml"
    mine.write_text('extends = "inspection"\nname = "mine"\n[[faults]]\nname = "gps"\nkind = "gps_outage"\n')
    assert call("validate", mine).out.splitlines()[1:] == [f"warning: {line}"]
    assert call("validate", "inspection", "--set", "faults.gps.kind=gps_outage", "--json").json["warnings"] == [line]
    show_unused_keys(rpojax.load(mine), quiet=False)
    show_unused_keys(rpojax.load(mine), quiet=True)
    assert capsys.readouterr().err == f"rpojax: warning: {line}\n"
