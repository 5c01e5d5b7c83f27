"""Tables of metrics: statistics over all runs, and values of one run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.metrics.metric_catalogue import worst_first
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import in_display_order, metric_label, of_all_servicers
from rpojax.report.number_format import format_number


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
    return (
        format_number(None)
        if ends is None
        else _with_statistic_name(key, f"{format_number(ends[0])} to {format_number(ends[1])}")
    )


def _with_statistic_name(key: str, text: str) -> str:
    """Text of a statistic, preceded by its name if that differs from the heading of its column."""
    return f"{key.partition('_')[0]} {text}" if key in ("p5", "p1", "p1_lower_95") else text


def _worst_row(name: str, values: np.ndarray) -> int | None:
    """Row of the worst run; None if fewer than two runs have a value, or all values are equal."""
    rows = worst_first(name, values)
    return int(rows[0]) if len(rows) > 1 and values[rows[0]] != values[rows[-1]] else None
