"""Verdict tiles: every requirement, passive safety and failed runs, each with its colour."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from rpojax.report.labels import metric_label
from rpojax.report.number_format import format_number, with_unit
from rpojax.report.sections import failure_section, requirement_verdict_section

Colour = Literal["good", "alert", "open"]


@dataclass(frozen=True)
class VerdictTile:
    """A verdict: what it is about, the verdict, a note, whether it is good, bad or open, and the section to read."""

    title: str
    value: str
    note: str
    css_class: str
    section: str


def verdict_tiles(content: Mapping[str, Any]) -> list[VerdictTile]:
    """Tiles of passive safety, of all requirements, and of failed runs; the bad ones first."""
    tiles = [
        VerdictTile(row.title, row.verdict, row.note + _worst(entry), row.css_class, "requirements")
        for row, entry in zip(
            requirement_verdict_section.rows(content["requirements"]), content["requirements"], strict=True
        )
    ]
    found = [*_passive_safety(content["safety"]), *tiles, *_of_runs(content)]
    order = ("alert", "open", "good")
    return sorted(found, key=lambda tile: order.index(tile.css_class))


def passive_safety_count(safety: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]] | None:
    """Longest horizon of free drift, and the proportion of runs that could enter the keep-out sphere within it."""
    known = [
        (drift["horizon"].replace("_", " "), drift["below_keep_out"])
        for drift in safety["free_drift"]
        if drift["below_keep_out"] is not None and drift["below_keep_out"]["runs"]
    ]
    if known:
        return known[-1]
    single = safety["passive_below_keep_out"]
    return None if single is None or not single["runs"] else ("1 orbit", single)


def _passive_safety(safety: Mapping[str, Any]) -> list[VerdictTile]:
    found = passive_safety_count(safety)
    if found is None:
        return []
    horizon, proportion = found
    least = safety["least_passive_range"]
    drifts = [drift["least_range"] for drift in safety["free_drift"] if drift["least_range"] is not None]
    least = drifts[-1] if drifts else least
    count, runs = proportion["count"], proportion["runs"]
    note = f"keep-out sphere in free drift within {horizon}"
    if least is not None:
        note += f"; nearest {with_unit(format_number(least['value'], 3), 'm')}, run {least['run_id']}"
    value = f"fails: {count} of {runs}" if count else f"holds: {runs} of {runs}"
    return [VerdictTile("Passive safety", value, note, "alert" if count else "good", "safety")]


def _worst(entry: Mapping[str, Any]) -> str:
    """Addition of the worst value, where there is no margin."""
    if entry["margin"] is not None or entry["worst"] is None:
        return ""
    unit = metric_label(entry.get("of", entry["metric"])).unit
    return f"; worst {with_unit(format_number(entry['worst'], 3), unit)}"


def _of_runs(content: Mapping[str, Any]) -> list[VerdictTile]:
    """Tiles of failed runs and, where there are any, of those that are not judged."""
    runs = content["runs"]
    ended = runs["requested"] - runs["missing"]
    note = "every run completed" if runs["completed"] == ended else ""
    if runs["failed"]:
        note = failure_section.outcomes_text(runs["outcomes"])
        if details := failure_section.detail_counts(content["failures"]):
            note += f"; most often {details[0][0]}" if len(details) > 1 else f"; {details[0][0]}"
    colour: Colour = "alert" if runs["failed"] else "good" if runs["completed"] == ended > 0 else "open"
    found = [VerdictTile("Failed runs", f"{runs['failed']} of {ended}", note, colour, "failures")]
    if runs["not_judged"]:
        why = "they end before limits.arrive_by_s: no failure, and no success"
        found.append(VerdictTile("Runs not judged", f"{runs['not_judged']} of {ended}", why, "open", "failures"))
    return found
