"""Tables and lines that commands print on stdout, and warnings on stderr."""

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from rpojax.metrics.metric_catalogue import find
from rpojax.report.labels import format_number, metric_label
from rpojax.report.sections.failure_section import without_time
from rpojax.report.sections.requirement_verdict_section import worst_text
from rpojax.runtime.progress import count_runs

_KEY_METRICS = (
    "formation_error_rms_m",
    "nav_relative_position_error_rms_m",
    "nav_servicer_position_error_rms_m",
    "nav_target_position_error_rms_m",
    "nees_relative_mean",
    "nees_mean",
    "sigma3_coverage",
    "delta_v_m_s",
    "min_range_m",
    "detection_rate",
    "pointing_error_p95_deg",
)


def show_campaign(summary: Mapping[str, Any]) -> None:
    """Prints key metrics and those of a plugin, runs by outcome, and the verdicts on requirements."""
    console = Console(highlight=False)
    runs = summary["runs"]
    ended = runs["requested"] - runs["missing"]
    # The name is user text: a Text does not interpret brackets as markup.
    table = Table(title=Text(f"{summary['provenance'].get('name', 'campaign')}, {count_runs(ended)}"))
    table.add_column("metric")
    table.add_column("unit")
    for heading in ("median", "p95", "p99", "worst") if ended > 1 else ("value",):
        table.add_column(heading, justify="right")
    for name in _shown_metrics(summary):
        if entry := summary["metrics"].get(name):
            shown = metric_label(name)
            twentieth, hundredth, _, worst = shown.tail_statistics
            keys = ("p50", twentieth, hundredth, worst) if ended > 1 else ("p50",)
            table.add_row(shown.title, shown.unit, *(_other_side(key) + format_number(entry[key]) for key in keys))
    if table.row_count:
        console.print(table)
    if lacking := _failed_without_value(summary):
        console.print(f"these statistics leave out {count_runs(lacking)} that failed and have no value", markup=False)
    console.print(f"runs: {_count_text(runs)}")
    if runs["missing"]:
        console.print(f"unfinished: {count_runs(runs['missing'])} missing", markup=False)
    for reason, count in _reasons(summary).items():
        console.print(f"failed: {count} x {reason}", markup=False)
    for line in _why(summary):
        console.print(line, markup=False, soft_wrap=True)
    for judged in summary["requirements"]:
        reached = f"; {judged['reached_text']}" if "reached_text" in judged else ""
        worst = worst_text(judged) if ended > 1 else ""
        text = f"{judged['verdict_text']}: {judged['text']}{reached}" + (f"; worst {worst}" if worst else "")
        console.print(text, markup=False, soft_wrap=True)
    if summary["requirements"] and runs.get("not_judged"):
        console.print("requirements count the runs that are not judged, too, up to where these end", markup=False)


def show_places(directory: Path, report: Path | None) -> None:
    """Prints the paths of results and report."""
    console = Console(highlight=False)
    console.print(f"results: {directory}", soft_wrap=True, markup=False)
    if report is not None:
        console.print(f"report: {report}", soft_wrap=True, markup=False)


def show_status(found: Mapping[str, Any]) -> None:
    """Prints progress, failures and speed of a campaign that may still be running."""
    console = Console(highlight=False)
    runs, blocks, timing = found["runs"], found["blocks"], found["timing"]

    def line(text: str) -> None:
        console.print(text, soft_wrap=True, markup=False)

    line(f"{found['name']}: {blocks['done']} of {blocks['total']} blocks done, {blocks['missing']} missing")
    line(f"runs: {_count_text(runs)}")
    if looks := found.get("sequential"):
        for text in _look_lines(looks):
            line(text)
    for reason, count in found["reasons"].items():
        line(f"failed: {count} x {reason}")
    for entry in found["lost"]:
        line(f"lost: block {entry['block']}, as {entry['file']} is {entry['found']}; a resume simulates it again")
    for entry in found["begun"]:
        line(f"begun: block {entry['block']}, attempt {entry['attempts']}")
    if timing:
        line(f"speed: {timing['run_seconds_per_s']:,.0f} simulated seconds per second in {timing['run_s']:,.0f} s")
    line(f"report: {found['report'] or 'none yet'}")


def _look_lines(found: Mapping[str, Any]) -> list[str]:
    """Lines on the looks of a sequential campaign, and on each requirement at the last one."""
    taken, planned = found["looks"]["taken"], found["looks"]["planned"]
    end = f"decided with {found['decided_at']} runs" if found["decided_at"] else f"at most {found['at_most']} runs"
    return [
        f"looks: {taken} of {planned} taken, {end}",
        *(
            f"{each['verdict']}: {each['requirement']}, {each['violations']} of {each['counted']} violate it"
            for each in found["requirements"]
        ),
    ]


def _count_text(runs: Mapping[str, Any]) -> str:
    """Completed, failed and requested runs, and those that were not judged where there are any."""
    not_judged = f"{runs['not_judged']} not judged, " if runs["not_judged"] else ""
    return f"{runs['completed']} completed, {runs['failed']} failed, {not_judged}{runs['requested']} requested"


def _failed_without_value(summary: Mapping[str, Any]) -> int:
    """Largest number of failed runs that a metric of the table has no value of."""
    runs, metrics = summary["runs"], summary["metrics"]
    ended = runs["requested"] - runs["missing"]
    known = [name for name in _shown_metrics(summary) if name in metrics]
    shown = [metrics[name]["defined"] for name in known if metrics[name]["defined"]]
    return min(runs["failed"], max((ended - defined for defined in shown), default=0)) if ended > 1 else 0


def _shown_metrics(summary: Mapping[str, Any]) -> list[str]:
    """Metrics of the table: the key ones, and those of the scenario's plugin."""
    own = [name for name in summary["metrics"] if (metric := find(name)) is not None and metric.source == "plugin"]
    return [*_KEY_METRICS, *own]


def _other_side(key: str) -> str:
    """Prefix with the percentile's name where low values are bad and the column heading names the upper one."""
    return f"{key} " if key in ("p1", "p5") else ""


def _reasons(summary: Mapping[str, Any]) -> dict[str, int]:
    reasons = [_with_detail(failure) for failure in summary["failures"]]
    return {reason: reasons.count(reason) for reason in sorted(set(reasons))}


def _why(summary: Mapping[str, Any]) -> list[str]:
    """A line for each cause of failed runs: runs, evidence, what would mend it; one on those without a cause."""
    found = summary["why_failed"]
    lines = [
        f"why: {each['runs']} x {each['text']}" + (f"; {each['mend']}" if each["mend"] else "")
        for each in found["causes"]
    ]
    return [*lines, *([f"why: no cause was found in {found['without']}"] if found["without"] else [])]


def _with_detail(failure: Mapping[str, Any]) -> str:
    detail = without_time(str(failure["detail"]))
    return f"{failure['reason']}: {detail}" if detail else str(failure["reason"])


def show_lines(warnings: Iterable[str]) -> None:
    """Prints warnings on stderr, a line for each."""
    for warning in warnings:
        print(f"rpojax: warning: {warning}", file=sys.stderr)
