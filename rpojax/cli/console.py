"""What a person sees: progress on stderr while runs are under way, tables on stdout when they are done."""

import datetime
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

if TYPE_CHECKING:
    from rpojax.campaign.run_and_resume import Progress

_KEY_METRICS = (
    "formation_error_rms_m",
    "nav_relative_position_error_rms_m",
    "nav_servicer_position_error_rms_m",
    "nav_target_position_error_rms_m",
    "nees_mean",
    "sigma3_coverage",
    "delta_v_m_s",
    "min_range_m",
    "detection_rate",
    "pointing_error_p95_deg",
)
_COMPILING = "compiling (up to a minute, a few seconds the next time)"
_PLAIN_SHARES = (0.25, 0.5, 0.75, 1.0)

Watch = Callable[["Progress"], None]


@contextmanager
def watching(duration_s: float, quiet: bool) -> Iterator[Watch]:
    """Something to tell the progress of runs of `duration_s` [s] to: a bar on a terminal, else a few lines."""
    if quiet:
        yield lambda _: None
    elif Console(stderr=True).is_terminal:
        with _bar(duration_s) as watch:
            yield watch
    else:
        yield _Lines(duration_s)


@contextmanager
def counting(text: str, quiet: bool) -> Iterator[Callable[..., None]]:
    """Something to tell `(done, total, note)` to: a bar on a terminal, else a line at every quarter."""
    if quiet:
        yield lambda done, total, note="": None
        return
    console = Console(stderr=True, highlight=False)
    if not console.is_terminal:
        shares = list(_PLAIN_SHARES)

        def line(done: int, total: int, note: str = "") -> None:
            while shares and done >= shares[0] * total:
                shares.pop(0)
                if not shares or done < shares[0] * total:
                    console.print(f"rpojax: {text}, {done} of {total} {note}".rstrip(), soft_wrap=True)

        yield line
        return
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Display

    columns = (TextColumn("{task.description}"), BarColumn(bar_width=20), TextColumn("{task.completed}/{task.total}"))
    with Display(*columns, TimeRemainingColumn(), console=console) as display:
        task = display.add_task(text, total=None)
        yield lambda done, total, note="": display.update(
            task, completed=done, total=total, description=f"{text} {note}".rstrip()
        )


@contextmanager
def busy(text: str, quiet: bool) -> Iterator[None]:
    """Says what is being done until it is done."""
    console = Console(stderr=True, quiet=quiet, highlight=False)
    if not console.is_terminal:
        console.print(f"rpojax: {text}", soft_wrap=True)
    with console.status(text) if console.is_terminal else nullcontext():
        yield


_SHORTEST_S = 0.05
"""In less time than this no rate can be told."""


class _Pace:
    """How fast runs of a given duration are done, from when the programs were compiled."""

    def __init__(self, duration_s: float) -> None:
        self.duration_s = duration_s
        self.begin: float | None = None

    def text(self, progress: "Progress") -> str:
        now = time.perf_counter()
        if self.begin is None:
            self.begin = now
        elapsed = now - self.begin
        if progress.done == 0.0:
            return f"{_count(progress.total)} to do"
        done = f"{progress.done:.0f}/{_count(progress.total)}"
        if elapsed < _SHORTEST_S:
            return f"{done}, {progress.failed} failed"
        rate = progress.done / elapsed
        left = datetime.timedelta(seconds=round((progress.total - progress.done) / rate))
        speed = f"{rate:.3g}/s, {rate * self.duration_s:,.0f} run-s/s"
        return f"{done}, {speed}, {left} left, {progress.failed} failed"


def _count(runs: int) -> str:
    return f"{runs} run{'' if runs == 1 else 's'}"


class _Lines:
    """A line when something begins, and at every quarter."""

    def __init__(self, duration_s: float) -> None:
        self._pace = _Pace(duration_s)
        self._console = Console(stderr=True, highlight=False)
        self._shares = list(_PLAIN_SHARES)

    def __call__(self, progress: "Progress") -> None:
        text = self._pace.text(progress) if progress.compiled else _COMPILING
        if progress.done == 0.0:
            self._console.print(f"rpojax: {text}", soft_wrap=True)
        passed = [share for share in self._shares if progress.done >= share * progress.total]
        if passed:
            self._shares = self._shares[len(passed) :]
            self._console.print(f"rpojax: {text}", soft_wrap=True)


@contextmanager
def _bar(duration_s: float) -> Iterator[Watch]:
    from rich.progress import BarColumn, SpinnerColumn, TextColumn
    from rich.progress import Progress as Display

    pace = _Pace(duration_s)
    columns = (SpinnerColumn(), BarColumn(bar_width=10), TextColumn("{task.description}"))
    with Display(*columns, console=Console(stderr=True, highlight=False)) as display:
        task = display.add_task(_COMPILING, total=None)

        def watch(progress: "Progress") -> None:
            if progress.compiled:
                display.update(task, total=progress.total, completed=progress.done, description=pace.text(progress))

        yield watch


def show_campaign(summary: Mapping[str, Any]) -> None:
    """Table of key metrics, how many runs completed and why others did not, and what became of the requirements."""
    from rich.table import Table
    from rich.text import Text

    from rpojax.report.labels import metric, number

    console = Console(highlight=False)
    runs = summary["runs"]
    ended = runs["completed"] + runs["failed"]
    # A name is the user's text: in a Text, brackets are no markup.
    table = Table(title=Text(f"{summary['provenance'].get('name', 'campaign')}, {_count(ended)}"))
    table.add_column("metric")
    table.add_column("unit")
    for heading in ("median", "p95", "p99", "worst") if ended > 1 else ("value",):
        table.add_column(heading, justify="right")
    for name in _KEY_METRICS:
        if entry := summary["metrics"].get(name):
            shown = metric(name)
            twentieth, hundredth, _, worst = shown.tail
            keys = ("p50", twentieth, hundredth, worst) if ended > 1 else ("p50",)
            table.add_row(shown.title, shown.unit, *(_other_side(key) + number(entry[key]) for key in keys))
    if table.row_count:
        console.print(table)
    console.print(f"runs: {runs['completed']} completed, {runs['failed']} failed, {runs['requested']} requested")
    if runs["missing"]:
        console.print(f"unfinished: {_count(runs['missing'])} missing", markup=False)
    for reason, count in _reasons(summary).items():
        console.print(f"failed: {count} x {reason}", markup=False)
    for judged in summary["requirements"]:
        console.print(f"{judged['verdict_text']}: {judged['text']}", markup=False, soft_wrap=True)


def show_places(directory: Path, report: Path | None) -> None:
    """Where the results of a campaign are."""
    console = Console(highlight=False)
    console.print(f"results: {directory}", soft_wrap=True, markup=False)
    if report is not None:
        console.print(f"report: {report}", soft_wrap=True, markup=False)


def show_status(found: Mapping[str, Any]) -> None:
    """Lines about a campaign that may be under way."""
    console = Console(highlight=False)
    runs, blocks, timing = found["runs"], found["blocks"], found["timing"]

    def line(text: str) -> None:
        console.print(text, soft_wrap=True, markup=False)

    line(f"{found['name']}: {blocks['done']} of {blocks['total']} blocks done, {blocks['missing']} missing")
    line(f"runs: {runs['completed']} completed, {runs['failed']} failed, {runs['requested']} requested")
    for reason, count in found["reasons"].items():
        line(f"failed: {count} x {reason}")
    for entry in found["begun"]:
        line(f"begun: block {entry['block']}, attempt {entry['attempts']}")
    if timing:
        line(f"speed: {timing['run_seconds_per_s']:,.0f} simulated seconds per second in {timing['run_s']:,.0f} s")
    line(f"report: {found['report'] or 'none yet'}")


def _other_side(key: str) -> str:
    """Name of a percentile that stands under the heading of the other side, because low values are the bad ones."""
    return f"{key} " if key in ("p1", "p5") else ""


def _reasons(summary: Mapping[str, Any]) -> dict[str, int]:
    reasons = [failure["reason"] for failure in summary["failures"]]
    return {reason: reasons.count(reason) for reason in sorted(set(reasons))}
