"""Progress of long work on stderr: one live line in a terminal, elsewhere a line a stage and one every half minute."""

import datetime
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Final

from rich.console import Console

from rpojax.runtime.jax_environment import is_slow

LINE_EVERY_S: Final = 30.0
"""Least time [s] from one line to the next within a stage, where there is no terminal."""
_WARM_UP: Final = 0.1
"""Share of the work below which a first step does not tell how long the others take."""
_COMPILING = "compiling (up to a minute, a few seconds the next time)"
_SLOW = "compiling (faster loop: rpojax.prepare_process() at the start)"
_SIMULATING = "simulating"
_LAST_RUNS = "free drifts and metrics of the last runs"


@dataclass(frozen=True)
class Progress:
    """Progress of a campaign.

    Attributes:
        done: run-equivalents finished in this session, fractions of runs under way included
        total: runs to do in this session
        failed: runs failed so far in this session
        compiled: whether the programs are compiled
        stage: what is done with the runs
    """

    done: float
    total: int
    failed: int
    compiled: bool
    stage: str = _SIMULATING


ProgressCallback = Callable[[Progress], None]


@contextmanager
def stage(text: str, quiet: bool, announce: bool = True) -> Iterator[None]:
    """Shows what the body does; without `announce`, for work that is mostly short, in a terminal only."""
    with _display(text, quiet) as show:
        if announce:
            show(text)
        yield


@contextmanager
def items(text: str, quiet: bool, announce: bool = False) -> Iterator[Callable[..., None]]:
    """Shows counted work by calls of the yielded function with `(done, total, note)`.

    Where there is no terminal the first line comes with the first count, or with `announce` before it.
    """
    pace = _Pace(str, lambda rate: f"{rate:,.0f}/s" if rate >= 100.0 else f"{rate:.3g}/s")
    with _display(text, quiet) as show:
        if announce:
            show(text)
        yield lambda done, total, note="": show(text, pace.describe(float(done), total, note), float(done), total)


@contextmanager
def run_progress(duration_s: float, quiet: bool) -> Iterator[ProgressCallback]:
    """Shows the progress of runs of `duration_s` [s] by calls of the yielded function."""
    paces = defaultdict[str, _Pace](partial(_Pace, count_runs, lambda rate: f"{rate * duration_s:,.0f} run-s/s"))
    with _display("starting", quiet) as show:

        def watch(progress: Progress) -> None:
            if not progress.compiled:
                show(_SLOW if is_slow() else _COMPILING)
                return
            count, failed = (progress.done, progress.total), f"{progress.failed} failed" if progress.done else ""
            show(progress.stage, paces[progress.stage].describe(*count, failed), *count)
            if progress.done >= progress.total and progress.stage == _SIMULATING:
                show(_LAST_RUNS)

        yield watch


def count_runs(number: int) -> str:
    """A number of runs in words, such as "1 run" or "3 runs"."""
    return f"{number} run{'' if number == 1 else 's'}"


class _Pace:
    """Speed of counted work since it left its first count, which is above zero where work is resumed.

    A first step that is small has what happens once, such as the warm-up of a program, and does not tell the time left.
    """

    def __init__(self, counted: Callable[[int], str], speed: Callable[[float], str]) -> None:
        self._counted, self._speed = counted, speed
        self._begin: tuple[float, float] | None = None
        self._warm: tuple[float, float] | None = None

    def describe(self, done: float, total: int, note: str) -> str:
        now = time.monotonic()
        if self._begin is None or done <= self._begin[0]:
            self._begin, self._warm = (done, now), None
        elif self._warm is None:
            self._warm = (done, now) if done - self._begin[0] < _WARM_UP * (total - self._begin[0]) else self._begin
        new, elapsed = done - self._begin[0], now - self._begin[1]
        words = [f"{done:.0f}/{self._counted(total)}", note]
        if new > 0.0 and elapsed > 0.0:
            words[:1] = [words[0], self._left(done, total, now)] if done < total else [f"{words[0]} in {elapsed:.1f} s"]
            words.append(self._speed(new / elapsed))
        return ", ".join(filter(None, words))

    def _left(self, done: float, total: int, now: float) -> str:
        """Time left in words, by the speed after the warm-up; empty while it is not known."""
        since, at = self._warm or (done, now)
        if done <= since:
            return ""
        return f"{datetime.timedelta(seconds=round((total - done) * (now - at) / (done - since)))} left"


@contextmanager
def _display(first: str, quiet: bool) -> Iterator[Callable[..., None]]:
    """Function that shows a stage, its state in words, and how much is done of how much.

    In a terminal `first` is shown at once.
    """
    console = Console(stderr=True, highlight=False)
    if quiet:
        yield lambda *_: None
    elif console.is_interactive and console.file.isatty():
        with _live_line(console, first) as show:
            yield show
    else:
        yield _Lines().show


@contextmanager
def _live_line(console: Console, first: str) -> Iterator[Callable[..., None]]:
    """A line that rich keeps moving and removes at the end; what else is printed on stderr appears above it."""
    from rich.constrain import Constrain
    from rich.progress import BarColumn, ProgressColumn, SpinnerColumn, Task, TextColumn
    from rich.progress import Progress as LiveDisplay
    from rich.table import Column
    from rich.text import Text

    class State(ProgressColumn):
        def render(self, task: Task) -> Text:
            words = task.fields["state"]
            if not 0.0 < task.completed < (task.total or 0.0):  # no time left is known
                words = f"{words} {datetime.timedelta(seconds=int(task.elapsed or 0.0))}".lstrip()
            text = Text(words)
            text.truncate(max(8, console.width - len(task.description) - 8), overflow="ellipsis")
            return text

    class LiveLine(LiveDisplay):
        def get_renderable(self) -> Constrain:
            return Constrain(super().get_renderable(), console.width - 3)  # the terminal shows ^C behind it

    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(bar_width=None))
    state = State(table_column=Column(no_wrap=True))
    options = {"transient": True, "expand": True, "redirect_stdout": False, "refresh_per_second": 4}
    with LiveLine(*columns, state, console=console, **options) as line:
        task = line.add_task(first, total=None, state="")
        shown = line.tasks[0]

        def show(stage: str, state: str = "", done: float = 0.0, total: int | None = None) -> None:
            if stage != shown.description:
                line.reset(task, description=stage)  # its time begins again
            shown.total = total
            line.update(task, completed=done, state=state)

        yield show


@dataclass
class _Lines:
    """Lines where there is no terminal: when a stage begins, every `LINE_EVERY_S`, and when all is counted."""

    stage: str = ""
    is_complete: bool = False
    last: float = 0.0

    def show(self, stage: str, state: str = "", done: float = 0.0, total: int | None = None) -> None:
        now, is_complete = time.monotonic(), total is not None and done >= total
        is_due = is_complete > self.is_complete or now >= self.last + LINE_EVERY_S
        if stage != self.stage or (state and is_due):
            self.last = now
            with suppress(OSError, ValueError):  # nobody reads it any more
                print(", ".join(filter(None, (f"rpojax: {stage}", state))), file=sys.stderr, flush=True)
        self.stage, self.is_complete = stage, is_complete
