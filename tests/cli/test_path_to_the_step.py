"""The path from the command of a campaign to the step of its closed loop, which the architecture page lists."""

import re
import traceback
from pathlib import Path
from typing import NoReturn

import pytest
from command_line_calls import Call

import rpojax
from rpojax.campaign.execution import run_programs
from rpojax.errors import RpojaxError


def test_the_path_of_a_campaign_on_the_page_is_that_of_the_calls(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "architecture.md").read_text(encoding="utf-8")
    [listed] = re.findall(r"path from the command to the step, in the order of the calls:(.*?)\.\n7\.", page, re.S)
    files: list[str] = []

    def step(*arguments: object) -> NoReturn:
        files.extend(frame.filename for frame in traceback.extract_stack())
        raise RpojaxError("step: reached")

    monkeypatch.setattr(run_programs, "step", step)
    outcome = call("campaign", "inspection", "--runs", 2, "--no-cache", "--out", tmp_path / "campaign")
    assert "step: reached" in outcome.err
    package = str(Path(rpojax.__file__).parent) + "/"
    path = list(dict.fromkeys(file.removeprefix(package) for file in files if file.startswith(package)))
    assert path == re.findall(r"`([a-z_/]+\.py)`", listed)
    assert len(path) <= 9
