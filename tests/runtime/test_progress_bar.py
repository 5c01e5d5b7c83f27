"""Progress display on stderr: lines in a file, a bar on a terminal."""

import pytest

from rpojax.runtime import progress_bar
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


def test_the_rate_counts_from_the_end_of_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([100.0, 102.0])
    monkeypatch.setattr(progress_bar.time, "perf_counter", lambda: next(clock))
    pace = progress_bar._Rate(600.0)
    assert pace.describe(Progress(done=0.0, total=10, failed=0, compiled=True)) == "10 runs to do"
    text = pace.describe(Progress(done=4.0, total=10, failed=1, compiled=True))
    assert text == "4/10 runs, 2/s, 1,200 run-s/s, 0:00:03 left, 1 failed"
