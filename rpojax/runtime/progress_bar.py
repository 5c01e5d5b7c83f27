"""Progress of long work on stderr: a bar on a terminal, otherwise a few lines."""

import datetime
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rich.console import Console

from rpojax.runtime.sign_of_life import SignOfLife, display, note_shown

_COMPILING = "compiling (up to a minute, a few seconds the next time)"

_PRINTED_FRACTIONS = (0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class Progress:
    """Progress of a campaign.

    Attributes:
        done: run-equivalents finished in this session, fractions of runs under way included
        total: runs to do in this session
        failed: runs failed so far in this session
        compiled: whether the programs are compiled
    """

    done: float
    total: int
    failed: int
    compiled: bool


ProgressCallback = Callable[[Progress], None]


def _print_line(console: Console, text: str) -> None:
    """Prints a line, which is a sign of life."""
    note_shown()
    console.print(f"rpojax: {text}", soft_wrap=True)


@contextmanager
def run_progress(duration_s: float, quiet: bool) -> Iterator[ProgressCallback]:
    """Shows the progress of runs of `duration_s` [s], by calls of the yielded function."""
    if quiet:
        yield lambda _: None
    elif Console(stderr=True).is_terminal:
        with display(), _progress_bar(duration_s) as watch:
            yield watch
    else:
        lines = _PlainLines(duration_s)
        with lines.sign_of_life:
            yield lines


@contextmanager
def item_progress(text: str, quiet: bool) -> Iterator[Callable[..., None]]:
    """Shows progress by calls of the yielded function with `(done, total, note)`: a bar, or a line at every quarter."""
    if quiet:
        yield lambda done, total, note="": None
        return
    console = Console(stderr=True, highlight=False)
    if not console.is_terminal:
        fractions = list(_PRINTED_FRACTIONS)

        sign = SignOfLife(lambda words: _print_line(console, words), text)

        def line(done: int, total: int, note: str = "") -> None:
            sign.describe(text, f"{done} of {total} {note}".rstrip() if done < total else "")
            while fractions and done >= fractions[0] * total:
                fractions.pop(0)
                if not fractions or done < fractions[0] * total:
                    _print_line(console, f"{text}, {done} of {total} {note}".rstrip())

        with sign:
            yield line
        return
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Display

    columns = (TextColumn("{task.description}"), BarColumn(bar_width=20), TextColumn("{task.fields[count]}"))
    with display(), Display(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console) as bar:
        task = bar.add_task(text, total=None, count="")
        yield lambda done, total, note="": bar.update(
            task, completed=done, total=total, count=f"{done}/{total}", description=f"{text} {note}".rstrip()
        )


@contextmanager
def busy(text: str, quiet: bool, announce: bool = True) -> Iterator[None]:
    """Shows `text` while the body runs, and every few seconds how long it has taken so far.

    Without `announce`, for work that is mostly short, there is no line at its begin where there is no terminal.
    """
    if quiet:
        yield
        return
    console = Console(stderr=True, highlight=False)
    if not console.is_terminal:
        if announce:
            _print_line(console, text)
        with SignOfLife(lambda words: _print_line(console, words), text):
            yield
        return
    with console.status(text) as status, SignOfLife(status.update, text):
        yield


_SHORTEST_S = 0.05
"""No rate is shown before this time."""


class _Rate:
    """Rate of runs of a given duration, from when the programs were compiled."""

    def __init__(self, duration_s: float) -> None:
        self.duration_s = duration_s
        self.begin: float | None = None

    def describe(self, progress: Progress) -> str:
        now = time.perf_counter()
        if self.begin is None:
            self.begin = now
        elapsed = now - self.begin
        if progress.done == 0.0:
            return f"{count_runs(progress.total)} to do"
        done = f"{progress.done:.0f}/{count_runs(progress.total)}"
        if elapsed < _SHORTEST_S:
            return f"{done}, {progress.failed} failed"
        rate = progress.done / elapsed
        left = datetime.timedelta(seconds=round((progress.total - progress.done) / rate))
        speed = f"{rate:.3g}/s, {rate * self.duration_s:,.0f} run-s/s"
        return f"{done}, {speed}, {left} left, {progress.failed} failed"


def count_runs(runs: int) -> str:
    """A number of runs in words, such as "1 run" or "3 runs"."""
    return f"{runs} run{'' if runs == 1 else 's'}"


class _PlainLines:
    """Prints a line at the start and at every quarter."""

    def __init__(self, duration_s: float) -> None:
        self._rate = _Rate(duration_s)
        self._console = Console(stderr=True, highlight=False)
        self._fractions = list(_PRINTED_FRACTIONS)
        self.sign_of_life = SignOfLife(self._print, "starting")

    def _print(self, text: str) -> None:
        _print_line(self._console, text)

    def __call__(self, progress: Progress) -> None:
        text = self._rate.describe(progress) if progress.compiled else _COMPILING
        if not progress.compiled:
            self.sign_of_life.describe("compiling")
        elif progress.done < progress.total:
            self.sign_of_life.describe("simulating", f"{progress.done:.0f} of {count_runs(progress.total)}")
        else:
            self.sign_of_life.describe("free drifts and metrics of the last runs")
        if progress.done == 0.0:
            self._print(text)
        passed = [fraction for fraction in self._fractions if progress.done >= fraction * progress.total]
        if passed:
            self._fractions = self._fractions[len(passed) :]
            self._print(text)


@contextmanager
def _progress_bar(duration_s: float) -> Iterator[ProgressCallback]:
    from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Display

    rate = _Rate(duration_s)
    columns = (SpinnerColumn(), BarColumn(bar_width=10), TextColumn("{task.description}"), TimeElapsedColumn())
    with Display(*columns, console=Console(stderr=True, highlight=False)) as bar:
        task = bar.add_task(_COMPILING, total=None)

        def watch(progress: Progress) -> None:
            if progress.compiled:
                bar.update(task, total=progress.total, completed=progress.done, description=rate.describe(progress))

        yield watch
