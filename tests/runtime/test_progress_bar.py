"""Progress display on stderr: lines in a file, a bar on a terminal."""

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import pytest

from rpojax.runtime import progress_bar, sign_of_life
from rpojax.runtime.progress_bar import Progress


def tell(watch: progress_bar.ProgressCallback) -> None:
    watch(Progress(done=0.0, total=4, failed=0, compiled=False))
    for done in (0.0, 1.0, 1.5, 3.0, 4.0):
        watch(Progress(done=done, total=4, failed=int(done > 2.0), compiled=True))


def test_lines_in_a_file_are_printed_at_every_quarter(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar.run_progress(100.0, quiet=False) as watch:
        tell(watch)
    captured = capsys.readouterr()
    starts = [line.split()[1] for line in captured.err.splitlines()]
    assert starts == ["compiling", "4", "1/4", "3/4", "4/4"]
    assert "1 failed" in captured.err.splitlines()[-1]
    assert captured.out == ""


def test_after_the_last_run_the_sign_of_life_is_not_that_of_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    stages: list[str] = []
    monkeypatch.setattr(sign_of_life.SignOfLife, "describe", lambda sign, *words: stages.append(", ".join(words)))
    with progress_bar.run_progress(100.0, quiet=False) as watch:
        tell(watch)
    assert stages[0] == "compiling"
    assert stages[-2:] == ["simulating, 3 of 4 runs", "free drifts and metrics of the last runs"]


def test_a_terminal_shows_a_bar(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "80")
    with progress_bar.run_progress(100.0, quiet=False) as watch:
        tell(watch)
    captured = capsys.readouterr()
    assert "━" in captured.err
    assert "4/4 runs" in captured.err
    assert "1 failed" in captured.err
    assert captured.out == ""


def test_a_terminal_shows_no_count_before_there_is_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    with progress_bar.item_progress("tuning", quiet=False):
        pass
    assert "None" not in capsys.readouterr().err
    with progress_bar.item_progress("tuning", quiet=False) as watch:
        watch(0, 80, "compiling runs")
    shown = capsys.readouterr().err
    assert "tuning compiling runs" in shown
    assert "0/80" in shown


def test_the_sign_of_life_of_counted_work_says_what_is_under_way(monkeypatch: pytest.MonkeyPatch) -> None:
    stages: list[str] = []
    monkeypatch.setattr(sign_of_life.SignOfLife, "describe", lambda sign, *words: stages.append(", ".join(words)))
    with progress_bar.item_progress("tuning", quiet=False) as watch:
        watch(0, 80, "compiling runs")
        watch(1, 80)
    assert stages == ["tuning, 0 of 80 compiling runs", "tuning, 1 of 80"]


def test_the_rate_counts_from_the_end_of_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([100.0, 102.0])
    monkeypatch.setattr(progress_bar.time, "perf_counter", lambda: next(clock))
    pace = progress_bar._Rate(600.0)
    assert pace.describe(Progress(done=0.0, total=10, failed=0, compiled=True)) == "10 runs to do"
    text = pace.describe(Progress(done=4.0, total=10, failed=1, compiled=True))
    assert text == "4/10 runs, 2/s, 1,200 run-s/s, 0:00:03 left, 1 failed"


STAGES: dict[str, Callable[[], AbstractContextManager[Any]]] = {
    "linear covariance": lambda: progress_bar.busy("linear covariance", quiet=False),
    "tuning": lambda: progress_bar.item_progress("tuning", quiet=False),
    "starting": lambda: progress_bar.run_progress(100.0, quiet=False),
}


@pytest.mark.parametrize("stage", STAGES)
def test_long_silence_is_broken_by_the_stage_and_the_time_so_far(
    stage: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sign_of_life, "INTERVAL_S", 0.02)
    shown, show = threading.Event(), sign_of_life.SignOfLife._watch
    monkeypatch.setattr(sign_of_life.SignOfLife, "_watch", lambda sign: (_announce(sign, shown), show(sign)))
    with STAGES[stage]():
        assert shown.wait(60.0)
    lines = [line for line in capsys.readouterr().err.splitlines() if line.endswith("s so far")]
    assert lines[0].startswith(f"rpojax: {stage}, ")


def test_progress_of_which_nothing_is_printed_is_no_sign_of_life(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sign_of_life, "INTERVAL_S", 0.2)
    end = time.monotonic() + 60.0
    lines: list[str] = []
    with progress_bar.item_progress("training", quiet=False) as tell_items:
        while not lines and time.monotonic() < end:
            tell_items(1, 1000)
            time.sleep(0.01)
            lines = [line for line in capsys.readouterr().err.splitlines() if line.endswith("s so far")]
    assert lines[0].startswith("rpojax: training, 1 of 1000, ")


def _announce(sign: sign_of_life.SignOfLife, shown: threading.Event) -> None:
    show = sign._show

    def show_and_tell(text: str) -> None:
        show(text)
        shown.set()

    sign._show = show_and_tell


@pytest.mark.parametrize("make", [progress_bar.busy, progress_bar.item_progress])
def test_a_quiet_display_shows_no_sign_of_life(
    make: Callable[..., AbstractContextManager[Any]],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sign_of_life.SignOfLife, "__enter__", lambda sign: pytest.fail("begun"))
    with make("tuning", quiet=True):
        pass
    assert capsys.readouterr().err == ""


def test_a_stage_counts_its_own_time(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr(sign_of_life, "INTERVAL_S", 3.0)
    monkeypatch.setattr(sign_of_life.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(sign_of_life._last_sign, "time", 100.0)
    lines: list[str] = []
    sign = sign_of_life.SignOfLife(lines.append, "compiling")
    waits = iter([False, False, False, True])

    def wait(_: float) -> bool:
        clock[0] += 6.0
        if clock[0] > 110.0:
            sign.describe("simulating") if clock[0] < 115.0 else None
        return next(waits)

    monkeypatch.setattr(sign._ended, "wait", wait)
    sign._watch()
    assert lines == ["compiling, 6 s so far", "simulating, 0 s so far", "simulating, 6 s so far"]
