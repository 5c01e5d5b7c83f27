"""The contents of the page's sections as plain records; the template only lays them out."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.analysis.statistics.binomial_intervals import clopper_pearson_interval
from rpojax.analysis.statistics.filter_consistency import mean_nees_interval
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.plotly_charts import Chart, add_reference_lines, envelope_chart, histogram_chart
from rpojax.report.labels import CHANNEL_LABELS, ChannelLabel, format_number, in_display_order, metric_label
from rpojax.report.page import shell_commands
from rpojax.report.run_independence import design_phrase, runs_are_independent
from rpojax.scenario.metric_catalogue import worst_first

_MAX_FAILURES = 50
_MAX_LINE_LENGTH = 4000
_NEES_COMPONENTS = 12
_NOMINAL_COVERAGE = 0.9973


@dataclass(frozen=True)
class Tile:
    """One headline number; `alert` marks one that needs attention."""

    title: str
    value: str
    unit: str
    note: str
    alert: bool = False


@dataclass(frozen=True)
class MetricRow:
    """One line of the metric tables; `cells` are mean, sd, min, p50, p95, p99, bound of p99 and max.

    `intervals` are those of mean, sd, p50, p95 and p99. Where a low value is the bad one, p5, p1 and the bound of p1
    stand in place of p95, p99 and its bound, and say so.
    """

    name: str
    title: str
    meaning: str
    unit: str
    cells: list[str]
    intervals: list[str]
    defined: int
    worst_run: int | None


def identity_lines(campaign: CampaignResults, summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Label and text of what identifies the campaign."""
    info, runs = campaign.info, summary["runs"]
    versions = ", ".join(f"{name} {version}" for name, version in info.get("versions", {}).items())
    missing = f", {runs['missing']} missing" if runs["missing"] else ""
    lines = [
        ("Scenario hash", info.get("scenario_hash")),
        ("Master seed", info.get("seed")),
        ("Runs", f"{runs['requested']} requested, {runs['completed']} completed, {runs['failed']} failed{missing}"),
        ("Replaced stages", _replaced_stages_text(info.get("stages") or {})),
        ("Versions", versions),
        ("Device", " ".join(str(info[key]) for key in ("device", "dtype") if key in info)),
        ("Block size", info.get("block_size")),
        ("Created", info.get("created")),
        ("Timing", _timing_text(info.get("timing") or {})),
        ("Design", "" if runs_are_independent(campaign) else f"{design_phrase(campaign)}: runs are not independent"),
        ("Any run again", shell_commands.rerun_command(campaign, "I", "DIR")),
    ]
    return [(label, str(text)) for label, text in lines if text not in (None, "")]


def _replaced_stages_text(stages: Mapping[str, Any]) -> str:
    return "; ".join(
        f"{name} = {stage['function']}, source {stage['source_sha256'] or 'unknown'}" for name, stage in stages.items()
    )


def headline_tiles(summary: Mapping[str, Any]) -> list[Tile]:
    """Headline numbers of the campaign."""
    metrics = summary["metrics"]
    coverage = _statistic(metrics, "sigma3_coverage", "mean")
    nees = _statistic(metrics, "nees_mean", "mean")
    return [
        _median_tile(metrics, "formation_error_rms_m"),
        _median_tile(metrics, "nav_relative_position_error_rms_m"),
        Tile("3-sigma coverage", format_number(coverage), "", f"mean; a normal error gives {_NOMINAL_COVERAGE}"),
        Tile(
            "NEES / 12",
            format_number(None if nees is None else nees / _NEES_COMPONENTS, 3),
            "",
            "mean; 1 is consistent",
        ),
        _median_tile(metrics, "delta_v_m_s"),
        _failure_tile(summary["runs"], summary["design"]["independent"]),
    ]


def metric_rows(campaign: CampaignResults, summary: Mapping[str, Any]) -> list[MetricRow]:
    """Lines of the metric table in the order of report.json."""
    rows = []
    for name, entry in summary["metrics"].items():
        shown = metric_label(name)
        keys = ("mean", "std", "min", "p50", *shown.tail_statistics[:3], "max")
        cells = [_with_statistic_name(key, format_number(entry[key])) for key in keys]
        row = _worst_row(name, campaign.metrics[name])
        worst = None if row is None else int(campaign.run_ids[row])
        ends = [
            _interval_text(key, entry[f"{key}_interval_95"])
            for key in ("mean", "std", "p50", *shown.tail_statistics[:2])
        ]
        rows.append(MetricRow(name, shown.title, shown.meaning, shown.unit, cells, ends, entry["defined"], worst))
    return rows


def _interval_text(key: str, ends: list[float | None] | None) -> str:
    return (
        format_number(None)
        if ends is None
        else _with_statistic_name(key, f"{format_number(ends[0])} to {format_number(ends[1])}")
    )


def _with_statistic_name(key: str, text: str) -> str:
    """Text of a statistic under a heading of the other side, with its own name."""
    return f"{key.partition('_')[0]} {text}" if key in ("p5", "p1", "p1_lower_95") else text


def envelope_charts(campaign: CampaignResults) -> dict[str, tuple[ChannelLabel, Chart]]:
    """Chart over time of every channel that holds a finite value, by the channel's name."""
    charts: dict[str, tuple[ChannelLabel, Chart]] = {}
    for channel in CHANNEL_LABELS:
        values = campaign.traces.get(channel.name)
        if values is None:
            continue
        bound = campaign.traces.get("nav_relative_sigma3_m") if channel.name == "nav_relative_error_m" else None
        completed = np.asarray(campaign.completed, dtype=bool)
        chart = envelope_chart(channel, campaign.trace_time_s, values, completed, bound, campaign.run_ids)
        if chart is not None:
            charts[channel.name] = (channel, chart)
    for name, levels in _reference_levels(campaign.info.get("scenario", {})).items():
        if name in charts:
            channel, chart = charts[name]
            add_reference_lines(chart, channel.unit, levels)
    return charts


def histogram_entries(campaign: CampaignResults, summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Title, median, p99 (p1 where low is bad) and chart of every metric; no chart where runs agree or none has it."""
    shown = []
    for name, entry in summary["metrics"].items():
        values = campaign.metrics[name]
        defined = values[np.isfinite(values)]
        shown_as, tail = metric_label(name), metric_label(name).tail_statistics[1]
        varies = len(defined) > 1 and float(np.ptp(defined)) > 0.0
        shown.append(
            {
                "name": name,
                "metric": shown_as,
                "p50": format_number(entry["p50"]),
                "tail": f"{tail} {format_number(entry[tail])}",
                "defined": len(defined),
                "chart": histogram_chart(shown_as, defined) if varies else None,
            }
        )
    return shown


def failure_table(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Count of each reason, the first failed runs, and how many more there are."""
    rows = summary["failures"]
    return {
        "reasons": Counter(row["reason"] for row in rows).most_common(),
        "rows": [{**row, "at_s": format_number(row["at_s"])} for row in rows[:_MAX_FAILURES]],
        "more": max(0, len(rows) - _MAX_FAILURES),
    }


def run_metrics(campaign: CampaignResults, run_id: int) -> list[tuple[str, str, str]]:
    """Title, value and unit of every metric of one run."""
    rows = np.flatnonzero(campaign.run_ids == run_id)
    metrics = campaign.metrics
    return [
        (metric_label(name).title, format_number(float(value)), metric_label(name).unit)
        for name in in_display_order(metrics)
        for value in metrics[name][rows]
    ]


def scenario_lines(campaign: CampaignResults) -> list[str]:
    """The resolved scenario as `section.key = value` lines, the form in which one value can be set from outside.

    Long lines, such as columns of a design's table, are cut short.
    """
    lines = _key_value_lines(campaign.info.get("scenario", {}), "")
    return [line if len(line) <= _MAX_LINE_LENGTH else f"{line[:_MAX_LINE_LENGTH]} ..." for line in lines]


def _timing_text(timing: Mapping[str, Any]) -> str:
    parts = [
        ("compile_s", "{} s compiling"),
        ("run_s", "{} s running"),
        ("run_seconds_per_s", "{} simulated seconds per second"),
        ("devices", "{} device(s)"),
    ]
    return ", ".join(text.format(format_number(float(timing[key]), 3)) for key, text in parts if key in timing)


def _statistic(metrics: Mapping[str, Any], name: str, key: str) -> float | None:
    return metrics[name][key] if name in metrics else None


def _median_tile(metrics: Mapping[str, Any], name: str) -> Tile:
    shown = metric_label(name)
    tail = shown.tail_statistics[1]
    note = f"median; {tail} {format_number(_statistic(metrics, name, tail), 3)} {shown.unit}"
    return Tile(shown.title, format_number(_statistic(metrics, name, "p50"), 3), shown.unit, note)


def _failure_tile(runs: Mapping[str, int], known: bool) -> Tile:
    failed, total = runs["failed"], runs["failed"] + runs["completed"]
    if total == 0:
        return Tile("Failed runs", "0", "", "no run has ended yet")
    if not known:
        return Tile("Failed runs", str(failed), f"of {total}", "runs are not independent", alert=failed > 0)
    low, high = clopper_pearson_interval(failed, total)
    note = f"95 % interval of the rate: {100.0 * low:.2g} to {100.0 * high:.2g} %"
    return Tile("Failed runs", str(failed), f"of {total}", note, alert=failed > 0)


def _worst_row(name: str, values: np.ndarray) -> int | None:
    """Row of the worst run; None where there is no other, or all agree."""
    rows = worst_first(name, values)
    return int(rows[0]) if len(rows) > 1 and values[rows[0]] != values[rows[-1]] else None


def _reference_levels(scenario: Mapping[str, Any]) -> dict[str, list[tuple[float, str]]]:
    low, high = mean_nees_interval(_NEES_COMPONENTS, 1, 0.9)
    levels = {"nees": [(low, "consistent filter, 5 %"), (12.0, "mean"), (high, "95 %")]}
    keep_out = scenario.get("limits", {}).get("keep_out_m")
    if keep_out is not None:
        levels["range_m"] = [(float(keep_out), "keep-out sphere")]
    return levels


def _key_value_lines(value: Any, path: str) -> list[str]:
    if isinstance(value, Mapping) and value:
        return [
            line
            for key, item in value.items()
            for line in _key_value_lines(item, f"{path}.{key}" if path else str(key))
        ]
    if isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
        return [f"{path}[{index}] = {json.dumps(item, default=str)}" for index, item in enumerate(value)]
    return [f"{path} = {json.dumps(value, default=str)}"] if path else []
