"""The verb, and runs that it refuses."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rpojax.campaign.store import Campaign
from rpojax.errors import RpojaxError
from rpojax.interop import flight_record, message_types
from rpojax.interop.flight_record import Flight


@pytest.fixture
def export(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], flight: Flight) -> Callable[..., Any]:
    """The verb in this process, with a flight that has been flown: exit status and what it said."""
    from rpojax import cli

    monkeypatch.setattr(flight_record, "fly", lambda *_, **__: flight)

    def run(*words: object) -> tuple[int, str]:
        capsys.readouterr()
        status = cli.main(["export-bag", *map(str, words)])
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


def test_a_run_that_the_campaign_does_not_have_is_refused(folder: Campaign) -> None:
    with pytest.raises(RpojaxError, match=r"--run-id: found 4, expected a run of this campaign, 0 to 3"):
        flight_record.fly(folder, 4)


def test_other_trained_files_or_stages_than_the_campaigns_are_refused(folder: Campaign, tmp_path: Path) -> None:
    described = json.loads((folder.directory / "campaign.json").read_text())
    (tmp_path / "campaign.json").write_text(json.dumps({**described, "scenario_hash": "0" * 64}))
    with pytest.raises(RpojaxError, match="scenario: found another content or trained files"):
        flight_record.fly(Campaign(tmp_path), 3)
