"""The command that writes recordings for the viewer."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.interop import run_replay
from rpojax.interop.rerun_viewer.rrd_chunks import ViewerChannels
from rpojax.interop.run_replay import ReplayedRun

Export = Callable[..., tuple[int, str]]


@pytest.fixture
def export(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], viewer_run: ReplayedRun[ViewerChannels]
) -> Export:
    """The command in this process, with a given replay: exit status and output."""
    from rpojax.cli import main

    monkeypatch.setattr(run_replay, "replay_servicers", lambda *_, **__: (viewer_run,))

    def run(*arguments: object) -> tuple[int, str]:
        capsys.readouterr()
        status = main.main(["export-rrd", *map(str, arguments)])
        output = capsys.readouterr()
        return status, output.err if status else output.out

    return run


def test_a_recording_is_written_and_described(campaign: Campaign, export: Export, tmp_path: Path) -> None:
    out = tmp_path / "new" / "run.rrd"
    status, output = export(campaign.directory, "--run-id", 3, "--out", out, "--json")
    assert status == 0
    assert json.loads(output) == {
        "file": str(out),
        "run_id": 3,
        "ticks": 180,
        "pictures": 0,
        "size_bytes": out.stat().st_size,
        "agreement": None,
    }
    refused = f"rpojax: error: {out}: exists already; --force replaces it\n"
    assert export(campaign.directory, "--run-id", 3, "--out", out) == (2, refused)
    again = f"{out}\nreplayed; the campaign has not recorded this run yet\n"
    assert export(campaign.directory, "--run-id", 3, "--out", out, "--force") == (0, again)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--out", "run.mp4"], "run.mp4: found suffix '.mp4', expected .rrd"),
        (["--out", "r.rrd", "--every", "0"], "--every: found 0, expected at least 1"),
    ],
)
def test_invalid_arguments_are_refused_in_one_line(
    campaign: Campaign, export: Export, arguments: list[str], error: str
) -> None:
    assert export(campaign.directory, "--run-id", 3, *arguments) == (2, f"rpojax: error: {error}\n")
