"""Writes the report of a campaign: one self-contained HTML page, report.json and the figures of one run."""

import json
import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape
from plotly.offline import get_plotlyjs

from rpojax.campaign.storage.atomic_outputs import write_atomically, write_json
from rpojax.errors import OutputError
from rpojax.report import shell_commands
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.coverage import coverage_section
from rpojax.report.figures.paper.paper_figures import missing_channels, write_figures
from rpojax.report.number_format import format_number, format_p_value
from rpojax.report.page.camera_sheet import CameraSheet, write_camera_sheet
from rpojax.report.page.report_json import report_content
from rpojax.report.page.run_selection import choose_run
from rpojax.report.page.template_values import (
    PageFigures,
    RunDetail,
    figure_values,
    page_charts,
    run_detail_values,
    table_values,
)
from rpojax.report.sections import identity_section
from rpojax.report.sections.dispersion_section import DrawnDistribution, drawn_distributions
from rpojax.report.team import team_section


def write_report(campaign: CampaignResults, run_id: int | None = None, film: bool = True) -> Path:
    """Writes report.html, report.json and the figures of one run into the campaign's folder; returns the page's path.

    Of a team the run is shown in detail as its first servicer had it.

    Args:
        campaign: results
        run_id: run shown in detail; by default the median one in formation error among those with full history
        film: whether to render the camera images of that run again, which takes some 20 s

    Raises:
        ResultError: no history of `run_id` is stored.
    """
    shown_run = choose_run(campaign, run_id)
    drawn = drawn_distributions(campaign)
    content = report_content(campaign, drawn)
    _refuse_symlink(campaign.directory / "figures")
    servicer = campaign.servicer_names[0] if campaign.servicer_names else ""
    figures: dict[str, Path] = {}
    missing: dict[str, list[str]] = {}
    if shown_run is not None:
        title = f"{campaign.info.get('name', 'campaign')}, run {shown_run}"
        title += f", servicer {servicer}" if servicer else ""
        history = campaign.history(shown_run, 0)
        figures, missing = write_figures(history, campaign.directory / "figures", title), missing_channels(history)
    camera = write_camera_sheet(campaign, shown_run) if film else CameraSheet(None, "They were left out by --no-film.")
    detail = RunDetail(shown_run, servicer, figures, missing, camera)
    pictures = PageFigures(coverage_section.write_figure(campaign), team_section.write_figure(campaign, shown_run))
    page = _render_page(campaign, content, drawn, detail, pictures)
    write_json(campaign.directory / "report.json", content)
    return write_atomically(campaign.directory / "report.html", page.encode())


def _refuse_symlink(folder: Path) -> None:
    """Raises OutputError if the folder for figures is a symbolic link."""
    if folder.is_symlink():
        raise OutputError(f"{folder}: found a link that leads elsewhere, expected a folder of the campaign")


def _render_page(
    campaign: CampaignResults,
    content: Mapping[str, Any],
    drawn: list[DrawnDistribution],
    detail: RunDetail,
    pictures: PageFigures,
) -> str:
    charts = page_charts(campaign, content)
    return (
        _environment()
        .get_template("template.html")
        .render(
            name=campaign.info.get("name", "campaign"),
            description=campaign.info.get("description", ""),
            rerun_command=partial(shell_commands.rerun_command, campaign),
            resume_command=shell_commands.resume_command(campaign),
            runs=content["runs"],
            warnings=content["warnings"],
            independent=content["design"]["independent"],
            scenario=identity_section.scenario_lines(campaign),
            limits=content["limits"],
            page_data=_script_json({"charts": charts.charts, "explorer": charts.explorer}),
            plotly=Markup(get_plotlyjs()),
            **charts.template_values,
            dispersions=drawn,
            **table_values(campaign, content),
            **run_detail_values(campaign, content, detail),
            **figure_values(pictures),
        )
    )


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = format_number
    environment.filters["breakable"] = _with_break_opportunities
    environment.filters["p_value"] = format_p_value
    return environment


def _with_break_opportunities(text: str) -> Markup:
    """A name that may break into lines after its underscores and dots only."""
    return Markup(re.sub(r"([_.])", r"\1<wbr>", str(escape(text))))


def _script_json(value: Any) -> Markup:
    """JSON, escaped so that it cannot end the script element around it."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))
