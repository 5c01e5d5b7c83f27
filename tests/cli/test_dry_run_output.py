"""`rpojax campaign --dry-run`: what would be flown, without flying it."""

import csv
import json
from pathlib import Path

import pytest

from rpojax.cli import main

GRID = (
    "--set",
    "dispersions=[]",
    "design={kind='grid', values={'servicer.mass_kg'=[29, 31], 'gps.noise_m'=[1.0, 2.0]}}",
)
SMALL = ("campaign", "inspection", "--block-size", "4", *GRID)


def call(*words: object) -> int:
    """Exit status of a command line."""
    return main.main([str(word) for word in words])


@pytest.fixture
def nothing_flies(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An empty folder to work in, where no campaign can be run."""

    def fly(*_: object, **__: object) -> None:
        raise AssertionError("a dry run flew")

    monkeypatch.setattr("rpojax.campaign.run_and_resume.start_campaign", fly)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_dry_run_writes_the_plan_and_nothing_else(nothing_flies: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(*SMALL, "--runs", 3, "--dry-run", "--plan", "plan.csv", "--out", "runs", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["values"] == {"gps.noise_m": [1.0, 2.0, 1.0], "servicer.mass_kg": [29.0, 29.0, 31.0]}
    assert printed["estimate"]["speed_source"].startswith("rough figure")
    assert [path.name for path in nothing_flies.iterdir()] == ["plan.csv"]
    rows = list(csv.reader((nothing_flies / "plan.csv").read_text().splitlines()))
    assert rows == [
        ["run_id", "seed", "gps.noise_m", "servicer.mass_kg"],
        ["0", "0", "1.0", "29.0"],
        ["1", "0", "2.0", "29.0"],
        ["2", "0", "1.0", "31.0"],
    ]
    assert call(*SMALL, "--runs", 4, "--dry-run", "--speed", 24000) == 0
    text = capsys.readouterr().out
    assert "4 runs of 6000 s, seed 0, grid draws of 2 keys" in text
    assert "time: about 0:00:01 beside compilation and report (24,000 run-s/s, given)" in text


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--runs", 3), "--out: missing"),
        (("--runs", 3, "--out", "runs", "--plan", "a.csv"), "--plan: found 'a.csv', expected it with --dry-run"),
        (("--runs", 3, "--out", "runs", "--speed", 3), "--speed: found '3.0', expected it with --dry-run"),
        (("--runs", 3, "--dry-run", "--speed", 0), "--speed: found 0.0"),
        (("--runs", 3, "--dry-run", "--plan", "there.csv"), "there.csv: exists already"),
        (("--runs", 3, "--dry-run", "--plan", "plan.txt"), "found suffix '.txt'"),
        (("--runs", 3, "--dry-run", "--out", "."), "--out: found '.'"),
        (("--runs", 0, "--dry-run"), "--runs: found 0"),
        (("--runs", 2_000_000_000, "--dry-run"), "--runs: found 2000000000, expected at most 250000000 for a plan"),
        (("--runs", 5, "--dry-run"), "--runs: found run 4, expected runs up to 3: the grid"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    nothing_flies: Path, capsys: pytest.CaptureFixture[str], words: tuple[object, ...], named: str
) -> None:
    (nothing_flies / "there.csv").write_text("")
    assert call(*SMALL, *words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert named in captured.err.splitlines()[-1]
    assert [path.name for path in nothing_flies.iterdir()] == ["there.csv"]
