"""Signals at every stage end a command with the documented status and one line."""

import shutil
import signal
from pathlib import Path

import pytest
from interrupted_commands import SHORT, STAGES, run_to_end, signalled

EARLY = ("import", "reading and drawing")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("stage", EARLY)
def test_a_signal_in_the_first_moments_has_a_line_and_no_traceback(
    tmp_path: Path, stage: str, number: signal.Signals
) -> None:
    words = ("campaign", "inspection", "--runs", "2", "--out", str(tmp_path / "runs"), *SHORT)
    found = signalled(stage, number, words, tmp_path / "runs")
    for _ in range(3):
        if "compiling" not in found.err:
            break
        # The signal came late, in another stage.
        shutil.rmtree(tmp_path / "runs", ignore_errors=True)
        found = signalled(stage, number, words, tmp_path / "runs")
    assert found.status == 128 + number
    assert found.err.startswith("rpojax: interrupted" if number == signal.SIGINT else "rpojax: terminated")
    assert "Traceback" not in found.err
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("stage", [stage for stage in STAGES if stage not in EARLY])
def test_a_signal_at_any_stage_has_the_documented_status_and_a_resume_finishes(
    tmp_path: Path, stage: str, number: signal.Signals
) -> None:
    out = tmp_path / "runs"
    words = ("campaign", "inspection", "--runs", "4", "--block-size", "2", "--out", str(out), "--no-film", *SHORT)
    found = signalled(stage, number, words, out)
    assert found.status == 128 + number
    assert "Traceback" not in found.err or stage == "start of Python"
    assert found.wait_s < 10.0
    if out.exists():
        assert run_to_end("resume", str(out)).status == 0
        assert run_to_end("resume", str(out)).status == 0
