"""The contents of the page's sections as plain records; the template only lays them out."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.analysis.statistics.binomial_intervals import proportion_interval
from rpojax.analysis.statistics.filter_consistency import mean_nees_interval
from rpojax.report.campaign_protocol import Results
from rpojax.report.figures.plotly_charts import Chart, envelope, histogram, reference_lines
from rpojax.report.labels import CHANNELS, Channel, metric, number, ordered
from rpojax.report.page import shell_commands
from rpojax.report.sections.design_caveat import in_words, independent
from rpojax.scenario.metric_catalogue import worst_rows

_MOST_FAILURES = 50
_LONGEST_LINE = 4000
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


def identity(campaign: Results, summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Label and text of what identifies the campaign."""
    info, runs = campaign.info, summary["runs"]
    versions = ", ".join(f"{name} {version}" for name, version in info.get("versions", {}).items())
    missing = f", {runs['missing']} missing" if runs["missing"] else ""
    lines = [
        ("Scenario hash", info.get("scenario_hash")),
        ("Master seed", info.get("seed")),
        ("Runs", f"{runs['requested']} requested, {runs['completed']} completed, {runs['failed']} failed{missing}"),
        ("Replaced stages", _replaced(info.get("stages") or {})),
        ("Versions", versions),
        ("Device", " ".join(str(info[key]) for key in ("device", "dtype") if key in info)),
        ("Block size", info.get("block_size")),
        ("Created", info.get("created")),
        ("Timing", _timing(info.get("timing") or {})),
        ("Design", "" if independent(campaign) else f"{in_words(campaign)}: runs are not independent"),
        ("Any run again", shell_commands.again(campaign, "I", "DIR")),
    ]
    return [(label, str(text)) for label, text in lines if text not in (None, "")]


def _replaced(stages: Mapping[str, Any]) -> str:
    return "; ".join(
        f"{name} = {stage['function']}, source {stage['source_sha256'] or 'unknown'}" for name, stage in stages.items()
    )


def tiles(summary: Mapping[str, Any]) -> list[Tile]:
    """Headline numbers of the campaign."""
    metrics = summary["metrics"]
    coverage = _statistic(metrics, "sigma3_coverage", "mean")
    nees = _statistic(metrics, "nees_mean", "mean")
    return [
        _median_tile(metrics, "formation_error_rms_m"),
        _median_tile(metrics, "nav_relative_position_error_rms_m"),
        Tile("3-sigma coverage", number(coverage), "", f"mean; a normal error gives {_NOMINAL_COVERAGE}"),
        Tile("NEES / 12", number(None if nees is None else nees / _NEES_COMPONENTS, 3), "", "mean; 1 is consistent"),
        _median_tile(metrics, "delta_v_m_s"),
        _failure_tile(summary["runs"], summary["design"]["independent"]),
    ]


def metric_rows(campaign: Results, summary: Mapping[str, Any]) -> list[MetricRow]:
    """Lines of the metric table in the order of report.json."""
    rows = []
    for name, entry in summary["metrics"].items():
        shown = metric(name)
        keys = ("mean", "std", "min", "p50", *shown.tail[:3], "max")
        cells = [_marked(key, number(entry[key])) for key in keys]
        row = _worst(name, campaign.metrics[name])
        worst = None if row is None else int(campaign.run_ids[row])
        ends = [_interval(key, entry[f"{key}_interval_95"]) for key in ("mean", "std", "p50", *shown.tail[:2])]
        rows.append(MetricRow(name, shown.title, shown.meaning, shown.unit, cells, ends, entry["defined"], worst))
    return rows


def _interval(key: str, ends: list[float | None] | None) -> str:
    return number(None) if ends is None else _marked(key, f"{number(ends[0])} to {number(ends[1])}")


def _marked(key: str, text: str) -> str:
    """Text of a statistic under a heading of the other side, with its own name."""
    return f"{key.partition('_')[0]} {text}" if key in ("p5", "p1", "p1_lower_95") else text


def envelopes(campaign: Results) -> dict[str, tuple[Channel, Chart]]:
    """Chart over time of every channel that holds a finite value, by the channel's name."""
    charts: dict[str, tuple[Channel, Chart]] = {}
    for channel in CHANNELS:
        values = campaign.traces.get(channel.name)
        if values is None:
            continue
        bound = campaign.traces.get("nav_relative_sigma3_m") if channel.name == "nav_relative_error_m" else None
        completed = np.asarray(campaign.completed, dtype=bool)
        chart = envelope(channel, campaign.trace_time_s, values, completed, bound, campaign.run_ids)
        if chart is not None:
            charts[channel.name] = (channel, chart)
    for name, levels in _levels(campaign.info.get("scenario", {})).items():
        if name in charts:
            channel, chart = charts[name]
            reference_lines(chart, channel.unit, levels)
    return charts


def histograms(campaign: Results, summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Title, median, p99 (p1 where low is bad) and chart of every metric; no chart where runs agree or none has it."""
    shown = []
    for name, entry in summary["metrics"].items():
        values = campaign.metrics[name]
        defined = values[np.isfinite(values)]
        shown_as, tail = metric(name), metric(name).tail[1]
        varies = len(defined) > 1 and float(np.ptp(defined)) > 0.0
        shown.append(
            {
                "name": name,
                "metric": shown_as,
                "p50": number(entry["p50"]),
                "tail": f"{tail} {number(entry[tail])}",
                "defined": len(defined),
                "chart": histogram(shown_as, defined) if varies else None,
            }
        )
    return shown


def failures(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Count of each reason, the first failed runs, and how many more there are."""
    rows = summary["failures"]
    return {
        "reasons": Counter(row["reason"] for row in rows).most_common(),
        "rows": [{**row, "at_s": number(row["at_s"])} for row in rows[:_MOST_FAILURES]],
        "more": max(0, len(rows) - _MOST_FAILURES),
    }


def chosen_metrics(campaign: Results, run_id: int) -> list[tuple[str, str, str]]:
    """Title, value and unit of every metric of one run."""
    rows = np.flatnonzero(campaign.run_ids == run_id)
    metrics = campaign.metrics
    return [
        (metric(name).title, number(float(value)), metric(name).unit)
        for name in ordered(metrics)
        for value in metrics[name][rows]
    ]


def scenario_lines(campaign: Results) -> list[str]:
    """The resolved scenario as `section.key = value` lines, the form in which one value can be set from outside.

    Long lines, such as columns of a design's table, are cut short.
    """
    lines = _flatten(campaign.info.get("scenario", {}), "")
    return [line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]} ..." for line in lines]


def _timing(timing: Mapping[str, Any]) -> str:
    parts = [
        ("compile_s", "{} s compiling"),
        ("run_s", "{} s running"),
        ("run_seconds_per_s", "{} simulated seconds per second"),
        ("devices", "{} device(s)"),
    ]
    return ", ".join(text.format(number(float(timing[key]), 3)) for key, text in parts if key in timing)


def _statistic(metrics: Mapping[str, Any], name: str, key: str) -> float | None:
    return metrics[name][key] if name in metrics else None


def _median_tile(metrics: Mapping[str, Any], name: str) -> Tile:
    shown = metric(name)
    tail = shown.tail[1]
    note = f"median; {tail} {number(_statistic(metrics, name, tail), 3)} {shown.unit}"
    return Tile(shown.title, number(_statistic(metrics, name, "p50"), 3), shown.unit, note)


def _failure_tile(runs: Mapping[str, int], known: bool) -> Tile:
    failed, total = runs["failed"], runs["failed"] + runs["completed"]
    if total == 0:
        return Tile("Failed runs", "0", "", "no run has ended yet")
    if not known:
        return Tile("Failed runs", str(failed), f"of {total}", "runs are not independent", alert=failed > 0)
    low, high = proportion_interval(failed, total)
    note = f"95 % interval of the rate: {100.0 * low:.2g} to {100.0 * high:.2g} %"
    return Tile("Failed runs", str(failed), f"of {total}", note, alert=failed > 0)


def _worst(name: str, values: np.ndarray) -> int | None:
    """Row of the worst run; None where there is no other, or all agree."""
    rows = worst_rows(name, values)
    return int(rows[0]) if len(rows) > 1 and values[rows[0]] != values[rows[-1]] else None


def _levels(scenario: Mapping[str, Any]) -> dict[str, list[tuple[float, str]]]:
    low, high = mean_nees_interval(_NEES_COMPONENTS, 1, 0.9)
    levels = {"nees": [(low, "consistent filter, 5 %"), (12.0, "mean"), (high, "95 %")]}
    keep_out = scenario.get("limits", {}).get("keep_out_m")
    if keep_out is not None:
        levels["range_m"] = [(float(keep_out), "keep-out sphere")]
    return levels


def _flatten(value: Any, path: str) -> list[str]:
    if isinstance(value, Mapping) and value:
        return [line for key, item in value.items() for line in _flatten(item, f"{path}.{key}" if path else str(key))]
    if isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
        return [f"{path}[{index}] = {json.dumps(item, default=str)}" for index, item in enumerate(value)]
    return [f"{path} = {json.dumps(value, default=str)}"] if path else []
