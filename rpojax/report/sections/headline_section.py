"""Headline numbers of a campaign as tiles."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rpojax.analysis.statistics.intervals import clopper_pearson_interval
from rpojax.report.labels import metric_label
from rpojax.report.number_format import format_number, format_percent_interval
from rpojax.report.sections import consistency_section
from rpojax.report.sections.failure_section import outcomes_text

_NEES_TILES = (("NEES / 6, relative", "nees_relative_mean", 6), ("NEES / 12", "nees_mean", 12))
"""Title, metric and number of components of each tile of NEES; the half that comes from GPS dilutes the second."""
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
