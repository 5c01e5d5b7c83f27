"""The command that writes bags."""

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
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], ros_run: ReplayedRun[RosTickValues]
) -> Callable[..., Any]:
    """The command in this process, with a given replay: exit status and output."""
    from rpojax.cli import main

    monkeypatch.setattr(run_replay, "replay_servicers", lambda *_, **__: (ros_run,))

    def run(*arguments: object) -> tuple[int, str]:
        capsys.readouterr()
        status = main.main(["export-bag", *map(str, arguments)])
        output = capsys.readouterr()
        return status, output.err if status else output.out

    return run


def test_a_bag_is_written(campaign: Campaign, export: Callable[..., Any], tmp_path: Path) -> None:
    out = tmp_path / "new" / "bag"
    status, output = export(campaign.directory, "--run-id", 3, "--format", "sqlite3", "--out", out, "--json")
    content = json.loads(output)
    assert (status, content["bag"], content["ticks"], content["agreement"]) == (0, str(out), 180, None)
    assert content["messages"] == 180 * 17 + 1
    assert sorted(path.name for path in out.iterdir()) == ["bag.db3", "metadata.yaml"]


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--run-id", "3", "--images", "raw"], "--images: found 'raw' for camera.model = 'geometric', expected 'none'"),
        (["--run-id", "3", "--out", "."], "--out: found '.', expected the name of a folder"),
    ],
)
def test_invalid_arguments_are_refused_in_one_line(
    campaign: Campaign, export: Callable[..., Any], tmp_path: Path, arguments: list[str], error: str
) -> None:
    arguments = arguments if "--out" in arguments else [*arguments, "--out", str(tmp_path / "bag")]
    assert export(campaign.directory, *arguments) == (2, f"rpojax: error: {error}\n")
    assert not (tmp_path / "bag").exists()


def test_without_rosbags_the_error_names_the_extra(
    campaign: Campaign, export: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    message_types.typestore.cache_clear()
    error = "rosbags.typesys: not installed, expected: pip install 'rpojax[ros]'"
    assert export(campaign.directory, "--run-id", 3, "--out", tmp_path / "bag") == (2, f"rpojax: error: {error}\n")
