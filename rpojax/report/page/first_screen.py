"""First screen of a campaign's page below its headline: one card for each fact, and three figures."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from rpojax.analysis.statistics.tolerance_verdicts import Verdict
from rpojax.metrics.passive_safety import horizon_metric_name
from rpojax.report.figures.requirement_limits import CHANNEL_OF_METRIC
from rpojax.report.labels import CHANNEL_LABELS, heading, metric_label
from rpojax.report.page.headline import ended_runs, passive_safety_count, weakest_requirement
from rpojax.report.page.next_steps import nearest_drift
from rpojax.report.sections import failure_section, requirement_verdict_section, safety_section

Colour = Literal["good", "alert", "open"]
_FIGURES: Final = 3


@dataclass(frozen=True)
class VerdictTile:
    """Tile of a verdict: subject, verdict, note, CSS class (good, bad or open), and section to read."""

    title: str
    value: str
    note: str
    css_class: str
    section: str


def verdict_tiles(content: Mapping[str, Any]) -> list[VerdictTile]:
    """Cards of passive safety, of all requirements, and of failed runs; the bad ones first, each fact once.

    A requirement that the longest free drift stays outside of the keep-out sphere is passive safety itself.
    """
    rows = requirement_verdict_section.rows(content["requirements"])
    safety, stated = content["safety"], False
    tiles = []
    for row, entry in zip(rows, content["requirements"], strict=True):
        title, section = row.title, "requirements"
        if _is_passive_safety(entry, safety):
            title, section, stated = f"Passive safety: {row.title[:1].lower()}{row.title[1:]}", "safety", True
        tiles.append(VerdictTile(title, row.verdict, row.note + _worst(entry), row.css_class, section))
    found = [*([] if stated else _passive_safety(safety)), *tiles, *_of_runs(content)]
    order = ("alert", "open", "good")
    return sorted(found, key=lambda tile: order.index(tile.css_class))


def _is_passive_safety(entry: Mapping[str, Any], safety: Mapping[str, Any]) -> bool:
    """Whether a requirement says what the card of passive safety would say."""
    horizons = [drift["horizon"] for drift in safety["free_drift"] if drift["below_keep_out"] is not None]
    if not horizons or entry["metric"] != horizon_metric_name(horizons[-1]) or "of" in entry:
        return False
    has_verdict = entry["verdict"] in (Verdict.VERIFIED, Verdict.NOT_VERIFIED, Verdict.MORE_RUNS, Verdict.UNDECIDED)
    return bool(has_verdict and entry["bound"] == "at least" and entry["limit"] == safety["keep_out_m"])


def _passive_safety(safety: Mapping[str, Any]) -> list[VerdictTile]:
    found = passive_safety_count(safety)
    if found is None:
        return []
    horizon, proportion = found
    least = nearest_drift(safety)
    count, runs = proportion["count"], proportion["runs"]
    note = f"keep-out sphere in free drift within {horizon}"
    if least is not None:
        note += f"; {safety_section.nearest_text(safety, least)}"
    note += safety_section.without_drift_text(proportion)
    value = f"fails: {count} of {runs}" if count else f"holds: {runs} of {runs}"
    colour: Colour = "alert" if count else "open" if proportion.get("without_drift") else "good"
    return [VerdictTile("Passive safety", value, note, colour, "safety")]


def _worst(entry: Mapping[str, Any]) -> str:
    """Addition of the worst value, where there is no margin or a run has none."""
    worst = requirement_verdict_section.worst_text(entry)
    return f"; worst {worst}" if worst and (entry["margin"] is None or entry["without_value"]) else ""


def _of_runs(content: Mapping[str, Any]) -> list[VerdictTile]:
    """Tiles of failed runs and, where there are any, of those that are not judged."""
    runs, ended = content["runs"], ended_runs(content)
    note = "every run completed" if runs["completed"] == ended else ""
    if runs["failed"]:
        note = failure_section.outcomes_text(runs["outcomes"])
        if causes := content["why_failed"]["causes"]:
            note += f"; most often {causes[0]['title']}" if len(causes) > 1 else f"; {causes[0]['title']}"
        elif details := failure_section.detail_counts(content["failures"]):
            note += f"; most often {details[0][0]}" if len(details) > 1 else f"; {details[0][0]}"
    colour: Colour = "alert" if runs["failed"] else "good" if runs["completed"] == ended > 0 else "open"
    found = [VerdictTile("Failed runs", f"{runs['failed']} of {ended}", note, colour, "failures")]
    if runs["not_judged"]:
        why = "they end before limits.arrive_by_s: no failure, and no success"
        found.append(VerdictTile("Runs not judged", f"{runs['not_judged']} of {ended}", why, "open", "failures"))
    return found


@dataclass(frozen=True)
class LeadingFigure:
    """A chart of the page by its name, with its title."""

    chart: str
    title: str


def leading_figures(content: Mapping[str, Any], charts: Collection[str]) -> list[LeadingFigure]:
    """At most three of the page's `charts`: mission or range, the channel of the weakest requirement, its histogram."""
    weakest = weakest_requirement(content["requirements"])
    name = "" if weakest is None else str(weakest.get("of", weakest["metric"]))
    channel = CHANNEL_OF_METRIC.get(name.partition("@")[0], "nav_relative_error_m")
    wanted = [
        *_phases(content),
        LeadingFigure("envelope-range_m", "Range to the target [m], all runs"),
        *([] if channel == "range_m" else [_envelope(channel)]),
        LeadingFigure(f"histogram-{name}", _histogram_title(name)),
        _envelope("formation_error_m"),
        _envelope("nav_relative_error_m"),
        _envelope("delta_v_m_s"),
    ]
    found: dict[str, LeadingFigure] = {}
    for figure in wanted:
        if figure.chart in charts:
            found.setdefault(figure.chart, figure)
    figures = list(found.values())
    spread = [figure for figure in figures if figure.chart.startswith("histogram-")]
    return [*[figure for figure in figures if figure not in spread][: _FIGURES - len(spread)], *spread]


def _phases(content: Mapping[str, Any]) -> list[LeadingFigure]:
    """Phases of the mission, where the runs were in more than one."""
    phases = (content.get("mission") or {}).get("phases", [])
    several = sum(phase["runs"] > 0 for phase in phases) > 1
    return [LeadingFigure("phase-shares", "Runs in each phase of the mission [%]")] if several else []


def _envelope(channel: str) -> LeadingFigure:
    label = next((one for one in CHANNEL_LABELS if one.name == channel), None)
    title = channel if label is None else f"{heading(label)}, all runs"
    return LeadingFigure(f"envelope-{channel}", title)


def _histogram_title(name: str) -> str:
    label = metric_label(name)
    return f"{heading(label)}, weakest requirement" if name else ""
