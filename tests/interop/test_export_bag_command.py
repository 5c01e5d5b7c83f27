"""The verb that writes bags."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.interop import run_replay
from rpojax.interop.ros2 import message_types
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.run_replay import ReplayedRun


@pytest.fixture
def export(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], flight: ReplayedRun[RosTickValues]
) -> Callable[..., Any]:
    """The verb in this process, with a flight that has been flown: exit status and what it said."""
    from rpojax.cli import main

    monkeypatch.setattr(run_replay, "replay", lambda *_, **__: flight)

    def run(*words: object) -> tuple[int, str]:
        capsys.readouterr()
        status = main.main(["export-bag", *map(str, words)])
        said = capsys.readouterr()
        return status, said.err if status else said.out

    return run


def test_the_verb_writes_a_bag(folder: Campaign, export: Callable[..., Any], tmp_path: Path) -> None:
    out = tmp_path / "new" / "bag"
    status, said = export(folder.directory, "--run-id", 3, "--format", "sqlite3", "--out", out, "--json")
    content = json.loads(said)
    assert (status, content["bag"], content["ticks"], content["agreement"]) == (0, str(out), 180, None)
    assert content["messages"] == 180 * 17 + 1
    assert sorted(path.name for path in out.iterdir()) == ["bag.db3", "metadata.yaml"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--run-id", "3", "--images", "raw"], "--images: found 'raw' for camera.model = 'geometric', expected 'none'"),
        (["--run-id", "3", "--out", "."], "--out: found '.', expected the name of a folder"),
    ],
)
def test_the_verb_refuses_in_one_line(
    folder: Campaign, export: Callable[..., Any], tmp_path: Path, words: list[str], said: str
) -> None:
    words = words if "--out" in words else [*words, "--out", str(tmp_path / "bag")]
    assert export(folder.directory, *words) == (2, f"rpojax: error: {said}\n")
    assert not (tmp_path / "bag").exists()


def test_without_rosbags_one_line_says_what_to_install(
    folder: Campaign, export: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    message_types.typestore.cache_clear()
    said = "rosbags.typesys: not installed, expected: pip install 'rpojax[ros]'"
    assert export(folder.directory, "--run-id", 3, "--out", tmp_path / "bag") == (2, f"rpojax: error: {said}\n")
