"""Progress on stderr: one live line that fits into a terminal and leaves nothing behind, few lines elsewhere."""

import io
import re
import sys
import threading
from collections.abc import Iterator

import pytest
from rich.console import Console

from rpojax.runtime import jax_environment, progress
from rpojax.runtime.progress import Progress, items, run_progress, stage


class Clock:
    """A clock that the test moves [s]."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    moved = Clock()
    monkeypatch.setattr(progress, "time", moved)
    return moved


class Terminal(io.StringIO):
    """A terminal of 80 columns, as far as a line that is drawn again and again needs one."""

    most_lines, longest, marks = 0, 0, frozenset[str]()

    def __init__(self) -> None:
        super().__init__()
        self.lines, self.row, self.column = [""], 0, 0

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        for sequence, letter in re.findall(r"\x1b\[([0-9;?]*[A-Za-z])|([^\x1b])", text):
            if sequence.endswith("A"):
                self.row -= int(sequence[:-1] or 1)
            elif sequence == "2K":
                self.lines[self.row] = ""
            elif letter == "\r":
                self.column = 0
            elif letter == "\n":
                self.row, self.column = self.row + 1, 0
                self.lines += [""] * (self.row + 1 - len(self.lines))
            elif letter:
                line = self.lines[self.row].ljust(self.column)
                self.lines[self.row] = line[: self.column] + letter + line[self.column + 1 :]
                self.column += 1
        assert self.row >= 0
        self.most_lines = max(self.most_lines, sum(map(bool, self.lines)))
        self.longest = max(self.longest, *map(len, self.lines))
        return super().write(text)

    def drawn(self) -> str:
        """All that was ever drawn, without colours."""
        return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", self.getvalue())


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "80")
    screen = Terminal()
    monkeypatch.setattr(progress, "Console", lambda **_: Console(file=screen, highlight=False))
    yield screen
    assert (screen.most_lines, [line for line in screen.lines if line]) == (1, [])
    assert screen.longest <= 77  # the terminal shows ^C in the three columns behind it


@pytest.mark.usefixtures("prepared")
def test_a_piped_campaign_has_a_line_a_stage_and_one_every_half_minute(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with run_progress(600.0, quiet=False) as watch:
        for _ in range(3):
            watch(Progress(done=0.0, total=128, failed=0, compiled=False))
            clock.now += 20.0
        for done in range(129):
            watch(Progress(done=float(done), total=128, failed=done // 40, compiled=True))
            clock.now += 0.5
        watch(Progress(done=0.5, total=2, failed=0, compiled=True, stage="simulating histories"))
        watch(Progress(done=2.0, total=2, failed=0, compiled=True, stage="simulating histories"))
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines() == [
        "rpojax: compiling (up to a minute, a few seconds the next time)",
        "rpojax: simulating, 0/128 runs",
        "rpojax: simulating, 60/128 runs, 0:00:34 left, 1 failed, 1,200 run-s/s",
        "rpojax: simulating, 120/128 runs, 0:00:04 left, 3 failed, 1,200 run-s/s",
        "rpojax: simulating, 128/128 runs in 64.0 s, 3 failed, 1,200 run-s/s",
        "rpojax: free drifts and metrics of the last runs",
        "rpojax: simulating histories, 0/2 runs, 0 failed",
        "rpojax: simulating histories, 2/2 runs, 0 failed",
    ]


def test_piped_items_have_their_note(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with items("tuning", quiet=False) as advance:
        advance(0, 80, "compiling runs")
        clock.now += 40.0
        advance(0, 80, "simulating")
        for step in range(1, 81):
            clock.now += 1.0
            advance(step, 80, f"objective {100 - step}")
    assert capsys.readouterr().err.splitlines() == [
        "rpojax: tuning, 0/80, compiling runs",
        "rpojax: tuning, 0/80, simulating",
        "rpojax: tuning, 30/80, 0:00:50 left, objective 70, 1/s",
        "rpojax: tuning, 60/80, 0:00:20 left, objective 40, 1/s",
        "rpojax: tuning, 80/80 in 80.0 s, objective 20, 1/s",
    ]


def test_nothing_is_said_of_counted_work_that_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="steps"), items("tuning", quiet=False):
        raise ValueError("steps")
    assert capsys.readouterr().err == ""
    with items("training", quiet=False, announce=True):
        assert capsys.readouterr().err == "rpojax: training\n"


def test_resumed_work_has_the_pace_of_what_is_new(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with items("training", quiet=False) as advance:
        advance(60, 80)
        clock.now += 30.0
        advance(70, 80)
    assert capsys.readouterr().err.splitlines()[-1] == "rpojax: training, 70/80, 0:00:30 left, 0.333/s"


def test_short_work_is_shown_in_a_terminal_only(capsys: pytest.CaptureFixture[str]) -> None:
    threads = threading.active_count()
    with stage("writing the report", quiet=False), stage("comparing runs", quiet=False, announce=False):
        assert threading.active_count() == threads
    assert capsys.readouterr().err == "rpojax: writing the report\n"


def test_quiet_work_shows_nothing(terminal: Terminal) -> None:
    with stage("a", quiet=True), items("b", quiet=True) as advance, run_progress(100.0, quiet=True) as watch:
        advance(1, 2, "note")
        watch(Progress(done=1.0, total=4, failed=0, compiled=True))
    assert terminal.getvalue() == ""
    terminal.most_lines = 1


def test_a_reader_that_is_gone_does_not_end_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    closed = io.StringIO()
    closed.close()
    monkeypatch.setattr(sys, "stderr", closed)
    lines = progress._Lines()
    lines.show("compiling")
    assert lines.stage == "compiling"


@pytest.fixture
def prepared(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process with the package's compiler flags."""
    monkeypatch.setattr(jax_environment, "_is_set_up", True)


def test_compilation_without_the_flags_of_the_package_says_so(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jax_environment, "_is_set_up", False)
    monkeypatch.setattr(jax_environment, "_has_begun", lambda: True)
    monkeypatch.setenv("XLA_FLAGS", "--xla_force_host_platform_device_count=2")
    with run_progress(600.0, quiet=False) as watch:
        watch(Progress(done=0.0, total=128, failed=0, compiled=False))
    assert "compiling (faster loop: rpojax.prepare_process() at the start)" in terminal.drawn()


@pytest.mark.usefixtures("prepared")
def test_a_terminal_shows_one_line_for_compilation_and_for_runs(clock: Clock, terminal: Terminal) -> None:
    with run_progress(600.0, quiet=False) as watch:
        watch(Progress(done=0.0, total=128, failed=0, compiled=False))
    assert "compiling (up to a minute, a few seconds the next time)" in terminal.drawn()
    with run_progress(600.0, quiet=False) as watch:
        watch(Progress(done=0.0, total=128, failed=0, compiled=True))
        clock.now += 10.0
        watch(Progress(done=32.0, total=128, failed=3, compiled=True))
    drawn = terminal.drawn()
    assert "simulating" in drawn
    assert "━" in drawn
    assert "32/128 runs, 0:00:30 left, 3 failed, 1,920 run-s/s" in drawn


def test_the_line_of_a_large_campaign_fits_into_80_columns(clock: Clock, terminal: Terminal) -> None:
    with run_progress(20_000.0, quiet=False) as watch:
        watch(Progress(done=0.0, total=10_000, failed=0, compiled=True))
        clock.now += 200.0
        watch(Progress(done=5_000.0, total=10_000, failed=1234, compiled=True))
    assert "5000/10000 runs, 0:03:20 left, 1234 failed, 500,000 run-s/s" in terminal.drawn()


def test_the_last_runs_have_a_stage_of_their_own(clock: Clock, terminal: Terminal) -> None:
    with run_progress(600.0, quiet=False) as watch:
        watch(Progress(done=4.0, total=4, failed=1, compiled=True))
    assert "free drifts and metrics of the last runs" in terminal.drawn()


def test_a_long_note_is_cut_and_not_wrapped(terminal: Terminal) -> None:
    with items("training", quiet=False) as advance:
        advance(1, 1000, "proposal network, mAP50 0.123, mAP50-95 0.045, and more than there is room for")
    assert "training" in terminal.drawn()


def test_an_error_leaves_no_line_behind(terminal: Terminal) -> None:
    with pytest.raises(KeyboardInterrupt), stage("writing the report", quiet=False):
        raise KeyboardInterrupt
    assert "\x1b[?25h" in terminal.getvalue()[-20:]  # the cursor is shown again


def test_a_slow_first_step_does_not_tell_the_time_left(clock: Clock) -> None:
    pace = progress._Pace(progress.count_runs, "{:.3g}".format)
    assert pace.describe(0.0, 1, "") == "0/1 run"
    clock.now += 10.0  # the program warms up
    assert "left" not in pace.describe(0.02, 1, "")
    clock.now += 0.5
    assert "0:00:07 left" in pace.describe(0.09, 1, "")
    clock.now += 6.5
    assert "in 17.0 s" in pace.describe(1.0, 1, "")
