"""Headline numbers of a campaign as tiles."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rpojax.analysis.statistics.intervals.binomial_intervals import clopper_pearson_interval
from rpojax.report.labels import metric_label
from rpojax.report.number_format import format_number

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


def headline_tiles(summary: Mapping[str, Any]) -> list[Tile]:
    """Medians of key metrics, coverage, NEES and failed runs."""
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


def _statistic(metrics: Mapping[str, Any], name: str, key: str) -> float | None:
    return metrics[name][key] if name in metrics else None


def _median_tile(metrics: Mapping[str, Any], name: str) -> Tile:
    label = metric_label(name)
    tail = label.tail_statistics[1]
    note = f"median; {tail} {format_number(_statistic(metrics, name, tail), 3)} {label.unit}"
    return Tile(label.title, format_number(_statistic(metrics, name, "p50"), 3), label.unit, note)


def _failure_tile(runs: Mapping[str, int], independent: bool) -> Tile:
    failed, total = runs["failed"], runs["failed"] + runs["completed"]
    if total == 0:
        return Tile("Failed runs", "0", "", "no run has ended yet")
    if not independent:
        return Tile("Failed runs", str(failed), f"of {total}", "runs are not independent", alert=failed > 0)
    low, high = clopper_pearson_interval(failed, total)
    note = f"95 % interval of the rate: {100.0 * low:.2g} to {100.0 * high:.2g} %"
    return Tile("Failed runs", str(failed), f"of {total}", note, alert=failed > 0)
