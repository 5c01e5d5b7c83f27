"""Metrics: headline tiles, tables of statistics over all runs, worst runs, and values of one run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.analysis.statistics.intervals import clopper_pearson_interval
from rpojax.metrics.metric_catalogue import worst_first
from rpojax.report.campaign_results import CampaignResults, select_key_metrics
from rpojax.report.labels import (
    format_interval,
    format_number,
    format_percent_interval,
    in_display_order,
    metric_label,
    of_all_servicers,
    with_unit,
)
from rpojax.report.sections import consistency_section
from rpojax.report.sections.failure_section import outcomes_text

_NEES_TILES = (("NEES / 6, relative", "nees_relative_mean", 6), ("NEES / 12", "nees_mean", 12))
"""Title, metric and number of components of each tile of NEES; the half that comes from GPS dilutes the second."""
_NOMINAL_COVERAGE = 0.9973
_PLACES = ("worst", "2nd", "3rd", "4th", "5th")


@dataclass(frozen=True)
class MetricRow:
    """Row of the metric tables; `cells` are mean, sd, min, p50, p95, p99, bound of p99 and max.

    `intervals` are those of mean, sd, p50, p95 and p99. Where low values are bad, p5, p1 and the bound of p1, marked
    as such, replace p95, p99 and its bound. `failed_without_value` runs failed and have none: the statistics are those
    of the other runs alone, and a dagger in `cells` says so.
    """

    name: str
    title: str
    meaning: str
    unit: str
    cells: list[str]
    intervals: list[str]
    defined: int
    runs: int
    failed_without_value: int
    worst_run: int | None


def metric_rows(campaign: CampaignResults, summary: Mapping[str, Any]) -> list[MetricRow]:
    """Rows of the metric table in the order of report.json; those of the servicers of a team have a table of theirs."""
    rows = []
    for name in of_all_servicers(summary["metrics"]):
        entry = summary["metrics"][name]
        label = metric_label(name)
        values = campaign.metrics[name]
        lacking = int(np.sum(~np.isfinite(values) & np.asarray(campaign.failed, dtype=bool)))
        keys = ("mean", "std", "min", "p50", *label.tail_statistics[:3], "max")
        cells = [
            _with_statistic_name(key, format_number(entry[key]) + _dagger(key, entry[key], lacking)) for key in keys
        ]
        row = _worst_row(name, values)
        worst = None if row is None else int(campaign.run_ids[row])
        ends = [
            _interval_text(key, entry[f"{key}_interval_95"])
            for key in ("mean", "std", "p50", *label.tail_statistics[:2])
        ]
        counts = entry["defined"], len(values), lacking
        rows.append(MetricRow(name, label.title, label.meaning, label.unit, cells, ends, *counts, worst))
    return rows


def run_metrics(campaign: CampaignResults, run_id: int) -> list[tuple[str, str, str]]:
    """Title, value and unit of every metric of one run."""
    rows = np.flatnonzero(campaign.run_ids == run_id)
    metrics = campaign.metrics
    return [
        (metric_label(name).title, format_number(float(value)), metric_label(name).unit)
        for name in in_display_order(metrics)
        for value in metrics[name][rows]
    ]


def _dagger(key: str, value: float | None, lacking: int) -> str:
    """Mark of a statistic of the runs with a value alone; bounds count the others as the worst."""
    return "\N{DAGGER}" if lacking and value is not None and not key.endswith("_95") else ""


def _interval_text(key: str, ends: list[float | None] | None) -> str:
    return format_interval(None) if ends is None else _with_statistic_name(key, format_interval(ends))


def _with_statistic_name(key: str, text: str) -> str:
    """Text of a statistic, preceded by its name if that differs from the heading of its column."""
    return f"{key.partition('_')[0]} {text}" if key in ("p5", "p1", "p1_lower_95") else text


def _worst_row(name: str, values: np.ndarray) -> int | None:
    """Row of the worst run; None if fewer than two runs have a value, or all values are equal."""
    rows = worst_first(name, values)
    return int(rows[0]) if len(rows) > 1 and values[rows[0]] != values[rows[-1]] else None


@dataclass(frozen=True)
class Tile:
    """One headline number; `alert` marks one that needs attention."""

    title: str
    value: str
    unit: str
    note: str
    alert: bool = False


def headline_tiles(summary: Mapping[str, Any]) -> list[Tile]:
    """Medians of key metrics, coverage, NEES and failed runs by outcome."""
    metrics = summary["metrics"]
    coverage = _statistic(metrics, "sigma3_coverage", "mean")
    low_runs = consistency_section.low_coverage_text(summary["consistency"])
    return [
        _median_tile(metrics, "formation_error_rms_m"),
        _median_tile(metrics, "nav_relative_position_error_rms_m"),
        Tile(
            "3-sigma coverage",
            format_number(coverage),
            "",
            f"mean; a normal error gives {_NOMINAL_COVERAGE}"
            + ("" if low_runs is None else f"; below 0.95 in {low_runs} of runs"),
        ),
        *(_nees_tile(metrics, *tile) for tile in _NEES_TILES),
        _median_tile(metrics, "delta_v_m_s"),
        _failure_tile(summary["runs"], summary["design"]["independent"]),
    ]


def _statistic(metrics: Mapping[str, Any], name: str, key: str) -> float | None:
    return metrics[name][key] if name in metrics else None


def _median_tile(metrics: Mapping[str, Any], name: str) -> Tile:
    label = metric_label(name)
    tail = label.tail_statistics[1]
    note = f"median; {tail} {format_number(_statistic(metrics, name, tail), 3)} {label.unit}"
    return Tile(label.title, format_number(_statistic(metrics, name, "p50"), 3), label.unit, note)


def _nees_tile(metrics: Mapping[str, Any], title: str, name: str, components: int) -> Tile:
    mean = _statistic(metrics, name, "mean")
    value = format_number(None if mean is None else mean / components, 3)
    return Tile(title, value, "", "mean; 1 is consistent")


def _failure_tile(runs: Mapping[str, Any], independent: bool) -> Tile:
    failed, total = runs["failed"], runs["requested"] - runs["missing"]
    if total == 0:
        return Tile("Failed runs", "0", "", "no run has ended yet")
    note = "runs are not independent"
    if independent:
        low, high = clopper_pearson_interval(failed, total)
        note = f"95 % interval of the rate: {format_percent_interval(low, high)}"
    if failed:
        note = f"{outcomes_text(runs['outcomes'])}; {note}"
    return Tile("Failed runs", str(failed), f"of {total}", note, alert=failed > 0)


def worst_runs(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: the five worst runs of each key metric, the worst first."""
    return [
        {
            "metric": name,
            "runs": [{"run_id": int(campaign.run_ids[row]), "value": float(values[row])} for row in worst_run_rows],
        }
        for name in select_key_metrics(campaign)
        for values in [campaign.metrics[name]]
        for worst_run_rows in [worst_first(name, values)[: len(_PLACES)]]
    ]


def worst_run_rows(entries: list[dict[str, Any]]) -> list[tuple[int, list[str]]]:
    """Run number and the metrics in which it is among the worst; runs that are so in most metrics first."""
    found: dict[int, list[str]] = {}
    for entry in entries:
        label = metric_label(entry["metric"])
        for place, run in enumerate(entry["runs"], start=1):
            value = with_unit(format_number(run["value"]), label.unit)
            found.setdefault(run["run_id"], []).append(f"{label.title} {value} ({_PLACES[place - 1]})")
    return sorted(found.items(), key=lambda item: (-len(item[1]), item[0]))
