"""The verb that writes recordings for the viewer."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.interop import run_replay
from rpojax.interop.rerun_viewer.viewer_channels import ViewerChannels
from rpojax.interop.run_replay import ReplayedRun

Export = Callable[..., tuple[int, str]]


@pytest.fixture
def export(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], shown: ReplayedRun[ViewerChannels]
) -> Export:
    """The verb in this process, with a run that has been flown: exit status and what it said."""
    from rpojax.cli import main

    monkeypatch.setattr(run_replay, "replay", lambda *_, **__: shown)

    def run(*words: object) -> tuple[int, str]:
        capsys.readouterr()
        status = main.main(["export-rrd", *map(str, words)])
        said = capsys.readouterr()
        return status, said.err if status else said.out

    return run


def test_the_verb_tells_what_it_wrote(folder: Campaign, export: Export, tmp_path: Path) -> None:
    out = tmp_path / "new" / "run.rrd"
    status, said = export(folder.directory, "--run-id", 3, "--out", out, "--json")
    assert status == 0
    assert json.loads(said) == {
        "file": str(out),
        "run_id": 3,
        "ticks": 180,
        "pictures": 0,
        "size_bytes": out.stat().st_size,
        "agreement": None,
    }
    refused = f"rpojax: error: {out}: exists already; --force replaces it\n"
    assert export(folder.directory, "--run-id", 3, "--out", out) == (2, refused)
    again = f"{out}\nflown again; the campaign has not recorded this run yet\n"
    assert export(folder.directory, "--run-id", 3, "--out", out, "--force") == (0, again)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "run.mp4"], "run.mp4: found suffix '.mp4', expected .rrd"),
        (["--out", "r.rrd", "--every", "0"], "--every: found 0, expected at least 1"),
    ],
)
def test_the_verb_refuses_in_one_line(folder: Campaign, export: Export, words: list[str], said: str) -> None:
    assert export(folder.directory, "--run-id", 3, *words) == (2, f"rpojax: error: {said}\n")
