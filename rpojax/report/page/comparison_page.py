"""Page on what changed between campaigns of the same runs: tables, overlays, and warnings where they differ in kind."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from rpojax.analysis.statistics.campaign_comparison import (
    CampaignComparison,
    defined_differently,
    relative_change,
    without,
)
from rpojax.analysis.statistics.intervals import percentiles_over_runs
from rpojax.analysis.statistics.paired_comparison import (
    MIN_PAIRS,
    IntervalEstimate,
    MedianChange,
    PairedComparison,
)
from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.errors import ResultError
from rpojax.metrics import metric_catalogue
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.colours import BLUE, GREEN, ORANGE, PURPLE, SHADE, VERMILLION
from rpojax.report.figures.plotly_charts import (
    Chart,
    band_traces,
    channel_line,
    chart_layout,
    chart_values,
    histogram_bins,
    limit_line,
    rounded_values,
    time_layout,
)
from rpojax.report.figures.requirement_limits import Limit
from rpojax.report.labels import (
    CHANNEL_LABELS,
    ChannelLabel,
    MetricLabel,
    format_number,
    format_p_value,
    in_display_order,
    metric_label,
    of_all_servicers,
)
from rpojax.report.page import page_templates
from rpojax.report.sections import requirement_verdict_section
from rpojax.scenario.plugins import plugin_registry
from rpojax.summary_text import counted

_CHANCE = 0.05
"""Share of metrics without a change whose 95 % interval excludes it nevertheless."""
COLOURS: Final = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SHADE)
_FILLS: Final = (
    "rgba(0, 114, 178, 0.15)",
    "rgba(213, 94, 0, 0.15)",
    "rgba(0, 158, 115, 0.15)",
    "rgba(204, 121, 167, 0.15)",
    "rgba(230, 159, 0, 0.15)",
    "rgba(138, 151, 168, 0.15)",
)
_MAX_POINTS: Final = 300
MAX_CAMPAIGNS: Final = len(COLOURS)
_LETTERS: Final = "ABCDEF"
_NEITHER: Final = ("nees", "innovation", "lag1", "log_likelihood", "final_range")
"""Parts of the names of metrics of which neither high nor low values are better in themselves."""
_SHOWN_FIRST: Final = 6
"""Changed metrics on the first screen."""
_CHANNELS: Final = {
    "formation_error": "formation_error_m",
    "nav_relative": "nav_relative_error_m",
    "range_m": "range_m",
    "delta_v": "delta_v_m_s",
    "nees": "nees",
}
"""Channel over time that a metric is made of, by a part of its name."""


@dataclass(frozen=True)
class ChangeRow:
    """A metric: title, unit, cells (medians, difference, its interval, ratio), whether, how and for good it changed."""

    name: str
    title: str
    unit: str
    cells: list[str]
    is_changed: bool
    direction: str
    tone: str


def change_rows(found: CampaignComparison) -> list[ChangeRow]:
    """Metrics that changed, the largest effect first, and then the others; of a team those of all servicers."""
    return [_change_row(change) for change in ranked_changes(found)]


def ranked_changes(found: CampaignComparison) -> list[MedianChange]:
    """Changed metrics by their relative change, then the others in display order."""
    by_name = {change.metric: change for change in found.runs.metrics}
    shown = [by_name[name] for name in of_all_servicers(in_display_order(by_name))]
    return sorted(shown, key=lambda change: -relative_change(change) if change.is_changed else 1.0)


def change_words(change: MedianChange) -> tuple[str, str]:
    """How a metric changed, and `good` or `alert`; of figures that should be near a value, only the direction."""
    difference = change.difference.value
    if not change.is_changed or difference is None:
        return "", ""
    direction = "higher" if difference > 0.0 else "lower"
    if any(part in change.metric for part in _NEITHER):
        return direction, ""
    is_better = (difference > 0.0) == metric_label(change.metric).low_is_bad
    return ("better", "good") if is_better else ("worse", "alert")


def event_rows(found: CampaignComparison) -> list[list[str]]:
    """Event, pairs with it in both, in the first alone, in the second alone, in neither, and p-value."""
    runs = found.runs
    return [
        [
            event.event,
            *map(str, (event.both, event.only_first, event.only_second, event.neither)),
            format_p_value(event.p_value),
        ]
        for event in (runs.failures, *runs.outcomes, *runs.requirements)
    ]


def comparison_sentence(found: CampaignComparison) -> str:
    """How many metrics changed, how many would by chance, and what became of failures."""
    runs = found.runs
    judged = [
        change for change in runs.metrics if "/" not in change.metric and change.difference.interval_95 is not None
    ]
    changed = sum(change.is_changed for change in judged)
    failed = runs.failures.both + runs.failures.only_first, runs.failures.both + runs.failures.only_second
    alone = f" ({runs.unpaired} without a partner)" if runs.unpaired else ""
    parts = [f"{runs.pairs} pairs of runs{alone}"]
    if found.independent and judged:
        by_chance = _CHANCE * len(judged)
        parts.append(
            f"the median of {changed} of {len(judged)} metrics changed (about {by_chance:.0f} would seem to by chance)"
        )
    if found.independent and runs.few:
        parts.append(few_pairs_text(runs))
    p_value = "" if runs.failures.p_value is None else f" (p {format_p_value(runs.failures.p_value)})"
    parts.append(f"failed runs {failed[0]} \N{RIGHTWARDS ARROW} {failed[1]}{p_value}")
    return "; ".join(parts) + "."


def few_pairs_text(runs: PairedComparison) -> str:
    """Which metrics have no interval, as too few pairs of runs have a value of them; empty if all have one."""
    which = "" if runs.pairs < MIN_PAIRS else f" for {counted(runs.few, 'metric')}"
    return f"no interval{which}: it needs {MIN_PAIRS} pairs of runs" if runs.few else ""


def requirement_table(campaigns: Sequence[CampaignResults]) -> list[tuple[str, list[tuple[str, str, str]]]]:
    """Requirement, and for each campaign verdict, CSS class and violations; a dash where it is not stated."""
    columns: list[dict[str, Any]] = []
    titles: list[str] = []
    for campaign in campaigns:
        missing = int(campaign.info.get("runs", len(campaign.completed))) - len(campaign.completed)
        rows = requirement_verdict_section.rows(requirement_verdict_section.content(campaign, missing))
        columns.append({f"{row.title}, {row.probability}": row for row in rows})
        titles += [title for title in columns[-1] if title not in titles]
    empty = ("\N{EN DASH}", "open", "not stated")
    return [
        (
            title,
            [
                (column[title].verdict, column[title].css_class, column[title].note.partition("; ")[2])
                if title in column
                else empty
                for column in columns
            ],
        )
        for title in titles
    ]


def _change_row(change: MedianChange) -> ChangeRow:
    label = metric_label(change.metric)
    direction, tone = change_words(change)
    cells = [
        format_number(change.first),
        format_number(change.second),
        signed(change.difference.value),
        interval_text(change.difference),
        format_number(change.ratio.value, 3),
        str(change.pairs),
    ]
    return ChangeRow(change.metric, label.title, label.unit, cells, change.is_changed, direction, tone)


def signed(value: float | None, digits: int = 3) -> str:
    """Number with its sign."""
    if value is None:
        return format_number(None)
    return f"{'+' if value > 0.0 else chr(0x2212) if value < 0.0 else ''}{format_number(abs(value), digits)}"


def interval_text(estimate: IntervalEstimate) -> str:
    """The 95 % interval, a dash without one."""
    ends = estimate.interval_95
    return format_number(None) if ends is None else f"{signed(ends[0])} to {signed(ends[1])}"


def histogram_overlay(
    name: str, campaigns: Sequence[CampaignResults], names: Sequence[str], limits: Sequence[Limit]
) -> Chart | None:
    """Share of the runs [%] by value of a metric, one stepped line for each campaign; None without variation."""
    label: MetricLabel = metric_label(name)
    columns = [np.asarray(campaign.metrics.get(name, ()), dtype=np.float64) for campaign in campaigns]
    finite = [values[np.isfinite(values)] for values in columns]
    together = np.concatenate(finite)
    if len(together) < 2 or float(np.ptp(together)) == 0.0:
        return None
    _, edges = histogram_bins(together)
    traces: list[dict[str, Any]] = []
    for number, values in enumerate(finite):
        if not len(values):
            continue
        share = 100.0 * np.histogram(values, bins=edges)[0] / len(columns[number])
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": rounded_values(np.repeat(edges, 2)),
                "y": rounded_values(np.concatenate([[0.0], np.repeat(share, 2), [0.0]])),
                "name": names[number],
                "line": {"color": COLOURS[number], "width": 1.8, "dash": "solid"},
                "hovertemplate": f"{names[number]}: %{{y:.3g}} % of its runs",
            }
        )
    layout = chart_layout(label.unit, "share of runs [%]")
    layout["shapes"] = [limit_line(limit.value, limit.text, upright=True) for limit in limits]
    return {"data": traces, "layout": layout}


def envelope_overlays(
    campaigns: Sequence[CampaignResults], names: Sequence[str]
) -> dict[str, tuple[ChannelLabel, Chart]]:
    """Channel and chart by name of every channel that all campaigns have: medians, and bands from 5 to 95 %."""
    found: dict[str, tuple[ChannelLabel, Chart]] = {}
    for channel in CHANNEL_LABELS:
        if all(channel.name in campaign.traces for campaign in campaigns):
            traces = [
                trace
                for number, campaign in enumerate(campaigns)
                for trace in _envelope(channel, campaign, names[number], number)
            ]
            if traces:
                found[channel.name] = (channel, {"data": traces, "layout": time_layout(channel, traces)})
    return found


def _envelope(channel: ChannelLabel, campaign: CampaignResults, name: str, number: int) -> list[dict[str, Any]]:
    values = np.asarray(campaign.traces[channel.name], dtype=np.float64)
    shown = np.flatnonzero(np.isfinite(values).any(axis=0)) if values.size else np.zeros(0, dtype=int)
    if not len(shown):
        return []
    shown = shown[:: -(-len(shown) // _MAX_POINTS)]
    time = rounded_values(campaign.trace_time_s[shown])
    low, middle, high = percentiles_over_runs(values[:, shown], (5.0, 50.0, 95.0))
    band = band_traces(
        time, chart_values(channel, low), chart_values(channel, high), f"{name}, 5\N{EN DASH}95 %", _FILLS[number]
    )
    return [*band, channel_line(channel, time, middle, f"{name}, median", COLOURS[number], 1.8)]


def write_comparison(
    campaigns: Sequence[CampaignResults], comparisons: Sequence[CampaignComparison], path: Path
) -> Path:
    """Writes the page on campaigns, each but the first compared with the first; returns its path.

    Raises:
        ResultError: the campaigns are more than there are colours for.
    """
    check_count(len(campaigns))
    own = {}
    for campaign in reversed(campaigns):
        own |= plugin_registry.recorded_metrics(campaign.info)
    with metric_catalogue.metrics_of_scenario(own):
        return _write(campaigns, comparisons, path)


def _write(campaigns: Sequence[CampaignResults], comparisons: Sequence[CampaignComparison], path: Path) -> Path:
    names = [f"{letter}: {each.directory.name}" for letter, each in zip(_LETTERS, campaigns, strict=False)]
    charts, values = _charts(campaigns, names)
    values |= {
        "title_text": " / ".join(names),
        "foot": page_templates.foot_text(campaigns[0].info) + f" \N{MIDDLE DOT} compared with {len(campaigns) - 1}",
        "names": names,
        "folders": [_identity(campaign) for campaign in campaigns],
        "requirements": requirement_table(campaigns),
        "leading": _leading(comparisons[0], charts),
        "parts": [_part(found, names[0], names[number]) for number, found in enumerate(comparisons, start=1)],
    }
    page = page_templates.render("comparison.html", {"charts": charts}, values)
    return write_atomically(path, page.encode("utf-8", "backslashreplace"))


def _leading(found: CampaignComparison, charts: dict[str, Chart]) -> list[tuple[str, str]]:
    """Names and titles of the charts of the first screen: the largest effects over time and over the runs."""
    names = [change.metric for change in ranked_changes(found)]
    over_time = [(f"envelope-{channel}", name) for name in names for part, channel in _CHANNELS.items() if part in name]
    histograms = [(f"histogram-{name}", name) for name in names]
    leading = []
    for candidates in (over_time, histograms):
        for chart, name in candidates:
            if chart in charts:
                charts[f"first-{chart}"] = charts[chart]
                over = ", over time" if chart.startswith("envelope") else ", share of runs"
                label = metric_label(name)
                leading.append((f"first-{chart}", f"{label.title}{over}{f' [{label.unit}]' if label.unit else ''}"))
                break
    return leading


def check_count(campaigns: int) -> None:
    """Refuses more campaigns than the page has colours for.

    Raises:
        ResultError: naming how many it takes.
    """
    if campaigns > MAX_CAMPAIGNS:
        raise ResultError(f"compare: found {campaigns} folders, expected at most {MAX_CAMPAIGNS}")


def _part(found: CampaignComparison, first: str, second: str) -> dict[str, Any]:
    """Tables of one campaign compared with the first."""
    return {
        "first": first,
        "second": second,
        "sentence": comparison_sentence(found),
        "warnings": found.warnings,
        "changed": [(change.key, _short(change.first), _short(change.second)) for change in found.changed],
        "rows": (rows := change_rows(found)),
        "shown": [row for row in rows if row.is_changed][:_SHOWN_FIRST],
        "events": event_rows(found),
        "independent": found.independent,
        "judged": any(change.difference.interval_95 is not None for change in found.runs.metrics),
    }


def _charts(campaigns: Sequence[CampaignResults], names: Sequence[str]) -> tuple[dict[str, Chart], dict[str, Any]]:
    limits = _limits(campaigns)
    differing = [name for campaign in campaigns[1:] for name in defined_differently(campaigns[0].info, campaign.info)]
    alike = without(campaigns[0].metrics, differing)
    together = [name for name in alike if all(name in each.metrics for each in campaigns)]
    charts: dict[str, Chart] = {}
    histograms = []
    for name in sorted(of_all_servicers(in_display_order(together)), key=lambda name: name not in limits):
        chart = histogram_overlay(name, campaigns, names, limits.get(name, []))
        if chart is not None:
            charts[f"histogram-{name}"] = chart
            histograms.append((name, metric_label(name)))
    envelopes = envelope_overlays(campaigns, names)
    charts |= {f"envelope-{name}": chart for name, (_, chart) in envelopes.items()}
    return charts, {"histograms": histograms, "envelopes": [channel for channel, _ in envelopes.values()]}


def _limits(campaigns: Sequence[CampaignResults]) -> dict[str, list[Limit]]:
    """Limits of the requirements of all campaigns by metric, each once; those in a window are left out."""
    found: dict[str, list[Limit]] = {}
    for campaign in campaigns:
        for entry in campaign.info.get("scenario", {}).get("requirements") or []:
            if any(entry.get(key) is not None for key in ("phase", "at", "from_s", "to_s")):
                continue
            limit = Limit(entry["metric"], float(entry["limit"]), entry["bound"] == "at most")
            if limit not in found.setdefault(limit.metric, []):
                found[limit.metric].append(limit)
    return found


def _identity(campaign: CampaignResults) -> list[tuple[str, str]]:
    info: Mapping[str, Any] = campaign.info
    failed = int(campaign.failed.sum())
    return [
        ("Folder", str(campaign.directory)),
        ("Scenario", f"{info.get('name', '')}, hash {info.get('scenario_hash', '')}"),
        ("Runs", f"{len(campaign.completed)}, {failed} failed; seed {info.get('seed', '')}"),
        ("Created", f"{info.get('created', '')}, rpojax {info.get('versions', {}).get('rpojax', '')}"),
    ]


def _short(value: Any) -> str:
    text = "\N{EN DASH}" if value is None else repr(value)
    return text if len(text) <= 120 else f"{text[:117]}..."
