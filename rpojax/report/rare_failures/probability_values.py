"""Values of estimated probabilities for the templates of pages."""

from collections.abc import Mapping, Sequence
from typing import Any

from rpojax.report.figures.charts.plotly_charts import Chart
from rpojax.report.rare_failures import probability_charts, probability_rows
from rpojax.report.rare_failures.probability_charts import NamedChart


def section_values(entries: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]] | None:
    """Estimates and wanted estimates of the section of a campaign's report; None without any."""
    if not entries:
        return None
    estimates = [
        {**estimate_values(entry["estimate"], charts), "same_scenario": entry["same_scenario"]}
        for entry, charts in _with_charts(entries)
    ]
    return {"estimates": estimates, "wanted": [entry for entry in entries if entry["kind"] == "wanted"]}


def section_charts(entries: Sequence[Mapping[str, Any]]) -> dict[str, Chart]:
    """Charts of the estimates of that section by name."""
    return {each.name: each.chart for _, charts in _with_charts(entries) for each in charts}


def estimate_values(content: Mapping[str, Any], charts: Sequence[NamedChart]) -> dict[str, Any]:
    """Sentences, charts and rows of one estimate."""
    headline, *sentences = probability_rows.sentences(content)
    return {
        "trusted": content["trusted"],
        "headline": headline,
        "sentences": sentences,
        "charts": charts,
        "levels": probability_rows.level_rows(content["levels"]),
        "points": probability_rows.design_point_rows(content["design_points"]),
        "runs": probability_rows.failing_run_rows(content["failing_runs"]),
        "noise": content["noise"],
        "unmapped": content["unmapped"],
    }


def _with_charts(entries: Sequence[Mapping[str, Any]]) -> list[tuple[Mapping[str, Any], list[NamedChart]]]:
    estimates = [entry for entry in entries if entry["kind"] == "estimate"]
    return [
        (entry, probability_charts.charts(entry["estimate"], f"probability-{number}"))
        for number, entry in enumerate(estimates)
    ]
