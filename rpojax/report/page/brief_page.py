"""The brief report: four A4 pages to print, for a review board."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.errors import ResultError
from rpojax.metrics import metric_catalogue
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.plotly_charts import Chart
from rpojax.report.left_out_parts import Notes
from rpojax.report.page import page_templates
from rpojax.report.page.detail_values import DetailValues, choose_run, detail_values
from rpojax.report.page.headline import ended_runs
from rpojax.report.page.report_json import report_content
from rpojax.report.page.run_page import is_single_run
from rpojax.report.page.run_timeline import TimelineRow
from rpojax.report.page.template_values import PageCharts, first_screen_values, page_charts
from rpojax.report.sections import (
    failure_section,
    identity_section,
    metrics_section,
    requirement_verdict_section,
    safety_section,
    sequential_section,
)
from rpojax.report.sections.dispersion_section import drawn_distributions
from rpojax.scenario.plugins import plugin_registry

FILE_NAME: Final = "brief.html"
_MOST_REQUIREMENTS, _MOST_METRICS, _MOST_CAVEATS, _MOST_WORST, _MOST_TILES = 10, 14, 6, 6, 12
_DETAIL_CHANNELS: Final = ("range_m", "formation_error_m", "nav_relative_error_m", "delta_v_m_s")
_METRICS: Final = (
    "formation_error_rms_m",
    "nav_relative_position_error_rms_m",
    "nav_servicer_position_error_rms_m",
    "nav_target_position_error_rms_m",
    "nees_relative_mean",
    "sigma3_coverage",
    "delta_v_m_s",
    "min_range_m",
    "pointing_error_p95_deg",
    "wheel_speed_peak_fraction",
    "look_away_peak_s",
    "longest_unseen_s",
    "time_to_acquire_s",
    "surface_seen_fraction",
)


def write_brief(campaign: CampaignResults, run_id: int | None = None) -> Path:
    """Writes brief.html, four A4 pages, into the campaign's folder; returns its path.

    Args:
        campaign: results of at least two runs
        run_id: run shown beside the worst ones; by default the median one in formation error among those with a history

    Raises:
        ResultError: the campaign has one run, or no history of `run_id` is stored.
    """
    with metric_catalogue.metrics_of_scenario(plugin_registry.recorded_metrics(campaign.info)):
        return _write(campaign, run_id)


def _write(campaign: CampaignResults, run_id: int | None) -> Path:
    notes = Notes()
    content = report_content(campaign, notes.part("Dispersions", drawn_distributions, campaign), notes)
    if is_single_run(content):
        raise ResultError(f"{campaign.directory}: found one run, expected a campaign of several for a brief report")
    charts = page_charts(campaign, content, notes)
    runs = notes.derived(
        "Runs in detail",
        lambda: detail_values(campaign, content, choose_run(campaign, run_id)),
        detail_values(campaign, content, None),
    )
    content["limits"] = list(dict.fromkeys([*notes.sentences, *content["limits"]]))
    values = notes.part("The page", lambda results: _values(results, content, charts, runs), campaign)
    wanted = {figure.chart for figure in values["leading"]}
    drawn: dict[str, Chart] = {name: chart for name, chart in charts.charts.items() if name in wanted}
    data = {"charts": drawn, "detail": runs.detail, "scene": runs.scene}
    page = page_templates.render("brief.html", data, values)
    return write_atomically(campaign.directory / FILE_NAME, page.encode("utf-8", "backslashreplace"))


def _values(
    campaign: CampaignResults, content: Mapping[str, Any], charts: PageCharts, runs: DetailValues
) -> dict[str, Any]:
    first = first_screen_values(campaign, content, charts)
    requirements = requirement_verdict_section.rows(content["requirements"])
    named = runs.template_values
    return {
        "name": campaign.info.get("name", "campaign"),
        "description": campaign.info.get("description", ""),
        "foot": page_templates.foot_text(campaign.info),
        "runs": content["runs"],
        "warnings": content["warnings"],
        "requirements": requirements[:_MOST_REQUIREMENTS],
        "plan_sentence": sequential_section.plan_sentence(content["requirements"], ended_runs(content)),
        "more_requirements": max(0, len(requirements) - _MOST_REQUIREMENTS),
        "safety": safety_section.rows(content["safety"])[:14],
        "metric_rows": _metric_rows(campaign, content),
        "failures": failure_section.failure_table(content),
        "shown_run": None if runs.detail is None else runs.detail["median"],
        "worst_shown": named["worst_shown"][:_MOST_WORST],
        "worst_choices": named["worst_choices"][:1],
        "timelines": {run: _main_rows(rows) for run, rows in named["timelines"].items()},
        "marks": named["marks"],
        "has_scene": named["has_scene"],
        "detail_channels": [channel for channel in named["detail_channels"] if channel["name"] in _DETAIL_CHANNELS],
        "limits": _shortest(content["limits"]),
        "identity": identity_section.identity_lines(campaign, content),
        **first,
        "verdict_tiles": first["verdict_tiles"][:_MOST_TILES],
        "next_steps": first["next_steps"][:4],
    }


def _metric_rows(campaign: CampaignResults, content: Mapping[str, Any]) -> list[metrics_section.MetricRow]:
    required = [str(entry.get("of", entry["metric"])) for entry in content["requirements"]]
    wanted = list(dict.fromkeys([*required, *_METRICS]))
    rows = {row.name: row for row in metrics_section.metric_rows(campaign, content)}
    return [rows[name] for name in wanted if name in rows and rows[name].defined][:_MOST_METRICS]


def _main_rows(rows: Sequence[TimelineRow]) -> list[TimelineRow]:
    """Rows of a timeline that fit on the sheet: all but light and confidence, at most four."""
    return [row for row in rows if row.title not in ("Light", "Confident")][:4]


def _shortest(sentences: Sequence[str]) -> list[str]:
    """The first caveats; how many more the full report has."""
    more = len(sentences) - _MOST_CAVEATS
    return [*sentences[:_MOST_CAVEATS], *([f"{more} more are in report.html."] if more > 0 else [])]
