"""Values for the page's template: charts, tables and the run shown in detail."""

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rpojax.report import rare_failures, shell_commands
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.camera_pictures import CameraSheet
from rpojax.report.figures.plotly_charts import Chart
from rpojax.report.figures.scatter_explorer import scatter_explorer
from rpojax.report.left_out_parts import Notes
from rpojax.report.page.first_screen import leading_figures, verdict_tiles
from rpojax.report.page.headline import ended_runs, headline, headline_notes
from rpojax.report.page.marked_runs import run_marks, shown_rows
from rpojax.report.page.metric_groups import histogram_groups
from rpojax.report.page.next_steps import next_steps
from rpojax.report.sections import (
    cause_section,
    consistency_section,
    convergence_section,
    coverage_section,
    detection_section,
    dispersion_section,
    driver_section,
    envelope_section,
    error_budget_section,
    failure_section,
    identity_section,
    metrics_section,
    phase_section,
    phase_visits,
    port_section,
    requirement_verdict_section,
    safety_section,
    sensitivity_section,
    sequential_section,
    simulation_section,
    team_section,
    trace_section,
)

_CAPTIONS = {
    "bearing_and_range.png": "Bearing unit vector from servicer to target in the Hill frame (left) and range from the "
    "size of the box (right). Dots are boxes that the filter accepted, crosses boxes that it rejected, triangles at an "
    "edge boxes beyond the scale; the thin line is the truth. Grey: the camera is turned away for a burn. Orange: "
    "search.",
    "estimation_error.png": "Position estimation error of target, of servicer, and of the servicer from the target, "
    "per Hill axis with 3-sigma bounds. The vertical scale fits the run after its first tenth, so the "
    "errors at hand-over may lie off scale.",
    "relative_position.png": "Position of the target from the servicer in the Hill frame: estimate, truth and desired. "
    "The sign is flipped in this figure only; elsewhere in this report it is the position of the servicer from the "
    "target.",
}


@dataclass(frozen=True)
class RunDetail:
    """Run that is shown in detail: its figures, the channels that the omitted figures lack, and its camera images.

    `servicer` is the name of the one that is shown of a team, empty for one alone.
    """

    run_id: int | None
    servicer: str
    figures: Mapping[str, Path]
    missing_channels: Mapping[str, list[str]]
    camera: CameraSheet


@dataclass(frozen=True)
class PageFigures:
    """Pictures of single sections, None if there are none: the target's coverage, the relative orbits of a team.

    `dark_coverage` is that of the coverage for the dark scheme, the bytes of a PNG file.
    """

    coverage: Path | None
    team: Path | None
    dark_coverage: bytes | None = None


def figure_values(figures: PageFigures) -> dict[str, Any]:
    """Pictures of single sections, empty if there are none."""
    named = {"coverage_figure": figures.coverage, "team_figure": figures.team}
    dark = figures.dark_coverage
    return {
        **{name: "" if path is None else _data_url(path) for name, path in named.items()},
        "dark_coverage_figure": "" if dark is None else _encoded(dark, "png"),
    }


@dataclass(frozen=True)
class PageCharts:
    """Charts by name, data of the scatter plot and of the runs, and the template values that place them."""

    charts: dict[str, Chart]
    explorer: dict[str, Any] | None
    runs: dict[str, Any] | None
    template_values: dict[str, Any]


def page_charts(campaign: CampaignResults, content: Mapping[str, Any], notes: Notes) -> PageCharts:
    """Charts of all sections; those that numbers do not allow are left out, with a note."""
    required = content["requirements"]
    envelopes = notes.derived("Envelopes", lambda: envelope_section.envelope_charts(campaign, required), {})
    averages = notes.derived("Averages of consistency", lambda: consistency_section.charts(campaign), {})
    histograms = notes.derived("Histograms", lambda: dispersion_section.histogram_entries(campaign, content), [])
    progress = content["convergence"]
    convergence = (
        {} if progress is None else notes.derived("Convergence", lambda: convergence_section.charts(progress), {})
    )
    rows = shown_rows(campaign)
    explorer = notes.derived("The scatter plot", lambda: scatter_explorer(campaign, rows, required), None)
    runs = notes.derived("Single runs", lambda: run_marks(campaign, content, list(envelopes)), None)
    charts: dict[str, Chart] = {f"envelope-{name}": chart for name, (_, chart) in envelopes.items()}
    charts |= {f"average-{name}": chart for name, (_, chart) in averages.items()}
    charts |= {f"histogram-{entry['name']}": entry["chart"] for entry in histograms if entry["chart"] is not None}
    charts |= {f"convergence-{name}": chart for name, (_, chart) in convergence.items()}
    shares = notes.part("Shares of phases", phase_visits.share_chart, campaign)
    charts |= {} if shares is None else {"phase-shares": shares}
    port, found = None, content["port"]
    if found is not None:
        port = notes.part("The docking port", lambda results: port_section.chart(results, found), campaign)
    charts |= {} if port is None else {"port": port}
    charts |= {f"sensitivity-{entry['metric']}": sensitivity_section.chart(entry) for entry in content["sensitivity"]}
    traces = notes.derived("Single runs over time", lambda: trace_section.charts(campaign, content), [])
    charts |= {} if campaign.history_ids else {trace.name: trace.chart for trace in traces}
    charts |= notes.derived("Rare failures", lambda: rare_failures.section_charts(content["rare_failures"]), {})
    template_values = {
        "envelopes": [channel for channel, _ in envelopes.values()],
        "averages": [channel for channel, _ in averages.values()],
        "histogram_groups": histogram_groups(histograms, {str(each.get("of", each["metric"])) for each in required}),
        "constants": [entry for entry in histograms if entry["chart"] is None and entry["defined"]],
        "undefined": [entry["metric"].title for entry in histograms if not entry["defined"]],
        "convergence": [(name, title) for name, (title, _) in convergence.items()],
        "explorer": explorer is not None,
        "port": found if port is not None else None,
        "traces": [trace for trace in traces if trace.name in charts],
    }
    return PageCharts(charts, explorer, runs, template_values)


def first_screen_values(campaign: CampaignResults, content: Mapping[str, Any], charts: PageCharts) -> dict[str, Any]:
    """Headline, what was simulated, cards, leading figures, and what to change."""
    requested, tiles = content["runs"]["requested"], verdict_tiles(content)
    return {
        "simulated": simulation_section.simulated_text(campaign.info, requested),
        "simulation": simulation_section.rows(campaign, content["why_failed"]["causes"]),
        "headline": headline(content),
        "headline_colour": tiles[0].css_class if tiles else "open",
        "headline_notes": headline_notes(content),
        "why": content["why_failed"],
        "verdict_tiles": tiles,
        "leading": leading_figures(content, charts.charts),
        "next_steps": next_steps(campaign, content),
    }


def table_values(campaign: CampaignResults, content: Mapping[str, Any], notes: Notes) -> dict[str, Any]:
    """Tables and tiles of all sections; those that numbers do not allow are empty, with a note."""
    consistency = content["consistency"]
    return {
        "identity": identity_section.identity_lines(campaign, content),
        "requirements": requirement_verdict_section.rows(content["requirements"]),
        "plan_sentence": sequential_section.plan_sentence(content["requirements"], ended_runs(content)),
        "tiles": metrics_section.headline_tiles(content),
        "metric_rows": notes.derived("Metrics", lambda: metrics_section.metric_rows(campaign, content), []),
        "safety": safety_section.rows(content["safety"]),
        "rare_failures": rare_failures.section_values(content["rare_failures"]),
        "entries": content["safety"]["entries"]["run_ids"],
        "mission": _mission_values(content),
        "team": team_section.tables(content),
        "coverage": coverage_section.rows(content),
        "consistency": {
            "means": consistency_section.mean_rows(consistency),
            "instants": consistency_section.time_rows(consistency),
            "whiteness": consistency_section.whiteness_rows(consistency),
        },
        "budgets": error_budget_section.budget_tables(content["error_budgets"]),
        "budget_histories": error_budget_section.histories_wanted(content["error_budgets"]),
        "budget_windows": error_budget_section.windows_text(content["error_budgets"]),
        "low_coverage": consistency_section.low_coverage_text(consistency),
        "drivers": driver_section.table(content["drivers"]),
        "sensitivity": content["sensitivity"],
        "failures": failure_section.failure_table(content),
        "why_rows": cause_section.rows(content["why_failed"]),
        "events": failure_section.event_table(content["events"]),
        "causes": [
            (
                cause,
                failure_section.sign_rows(cause),
            )
            for cause in content["failure_causes"]
        ],
        "faults": {
            "rows": notes.part("Faults", failure_section.fault_rows, campaign),
            "headings": failure_section.headings(),
        },
        "worst": metrics_section.worst_run_rows(content["worst_runs"]),
    }


def _mission_values(content: Mapping[str, Any]) -> dict[str, Any] | None:
    """Tables of the phases and of aborts, None without phases."""
    mission = content["mission"]
    if mission is None:
        return None
    return {
        "goal": phase_section.goal_text(mission),
        "times": phase_section.time_rows(mission),
        "headings": phase_section.figure_headings(),
        "figures": phase_section.figure_rows(mission),
        "further_stays": mission["runs_with_further_stays"],
        "abort_sentences": phase_section.abort_sentences(mission["aborts"]),
        "aborts": phase_section.abort_rows(mission["aborts"]),
    }


def run_detail_values(campaign: CampaignResults, content: Mapping[str, Any], detail: RunDetail) -> dict[str, Any]:
    """Detections, camera images and figures of the run shown in detail."""
    return {
        "shown_run": detail.run_id,
        "shown_servicer": detail.servicer,
        "shown_run_metrics": [] if detail.run_id is None else metrics_section.run_metrics(campaign, detail.run_id),
        "detections": detection_section.table_cells(content["detections"]),
        "rendered": campaign.info.get("scenario", {}).get("camera", {}).get("model") == "rendered",
        "camera_sheet": "" if detail.camera.path is None else _data_url(detail.camera.path),
        "no_camera_sheet": detail.camera.reason,
        "film_command": shell_commands.film_command(campaign, detail.run_id),
        "figures": [(_CAPTIONS[name], _data_url(path)) for name, path in detail.figures.items()],
        "omitted_figures": [
            f"{name} is omitted: the channels {', '.join(channels)} of this run were not kept."
            for name, channels in detail.missing_channels.items()
        ],
    }


def _data_url(path: Path) -> str:
    """Picture as a data URL."""
    kind = "jpeg" if path.suffix == ".jpg" else "png"
    return _encoded(path.read_bytes(), kind)


def _encoded(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64," + base64.b64encode(content).decode()
