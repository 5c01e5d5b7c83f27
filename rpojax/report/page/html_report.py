"""One self-contained page and its JSON twin for a campaign."""

import base64
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape
from plotly.offline import get_plotlyjs

from rpojax.errors import OutputError, RpojaxError
from rpojax.report.atomic_output import write_atomically, write_json
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.paper_figures import missing_channels, write_figures
from rpojax.report.figures.plotly_charts import Chart
from rpojax.report.labels import format_number, format_p_value
from rpojax.report.page import section_records, shell_commands
from rpojax.report.page.campaign_summary import choose_run
from rpojax.report.page.report_json import report_content
from rpojax.report.sections import (
    consistency_section,
    convergence_section,
    detection_section,
    dispersion_section,
    failure_section,
    fault_section,
    requirement_verdict_section,
    safety_section,
    sensitivity_section,
    worst_runs_section,
)

_CAPTIONS = {
    "bearing_and_range.png": "Bearing unit vector from servicer to target in the Hill frame (left) and range from the "
    "size of the box (right). Dots are boxes that the filter accepted, crosses boxes that it refused, triangles at an "
    "edge boxes beyond the scale, the thin line is the truth. Grey: the camera looks away for a burn. Orange: it "
    "searches.",
    "estimation_error.png": "Position estimation error of target, of servicer, and of the servicer from the target, "
    "per Hill axis with 3-sigma bounds. The vertical scale is that of the run after its first tenth, so the "
    "hand-over may lie off scale.",
    "relative_position.png": "Position of the target from the servicer in the Hill frame: estimate, truth and desired. "
    "The sign is flipped in this figure only; elsewhere in this report the position is that of the servicer from the "
    "target.",
}


def write_report(campaign: CampaignResults, run_id: int | None = None, film: bool = True) -> Path:
    """Writes report.html, report.json and the figures of one run into the campaign's folder; returns the page's path.

    `run_id` chooses the run shown in detail (default: the median one in formation error among kept histories), `film`
    whether to take pictures of its rendered camera again, which costs some 20 s. Raises ResultError where no history of
    `run_id` is kept.
    """
    shown = choose_run(campaign, run_id)
    drawn = dispersion_section.drawn_distributions(campaign)
    content = report_content(campaign, drawn)
    _refuse_symlink(campaign.directory / "figures")
    figures: dict[str, Path] = {}
    left_out: dict[str, list[str]] = {}
    if shown is not None:
        title = f"{campaign.info.get('name', 'campaign')}, run {shown}"
        history = campaign.history(shown)
        figures, left_out = write_figures(history, campaign.directory / "figures", title), missing_channels(history)
    seen = _camera_sheet(campaign, shown) if film else CameraSheet(None, "It was left out by --no-film.")
    page = _render_page(campaign, content, drawn, RunDetail(shown, figures, left_out, seen))
    write_json(campaign.directory / "report.json", content)
    return write_atomically(campaign.directory / "report.html", page.encode())


def _refuse_symlink(folder: Path) -> None:
    """Refuses a folder for figures that leads elsewhere."""
    if folder.is_symlink():
        raise OutputError(f"{folder}: found a link that leads elsewhere, expected a folder of the campaign")


@dataclass(frozen=True)
class CameraSheet:
    """Strip of what a camera saw, or why there is none."""

    path: Path | None
    reason: str = ""


def _camera_sheet(campaign: CampaignResults, shown: int | None) -> CameraSheet:
    if shown is None:
        return CameraSheet(None, "No full history was kept.")
    # Here, because it takes what a simulation takes.
    from rpojax.campaign import rerender
    from rpojax.dispersions.designs import recorded_run_range
    from rpojax.report.figures import camera_film

    if campaign.info["scenario"].get("camera", {}).get("model") != "rendered":
        return CameraSheet(None, "The scenario's camera takes no pictures.")
    try:
        file = rerender.rendered_scenario(campaign.info)
        history = campaign.history(shown)
        if not rerender.is_renderable(history, file):
            return CameraSheet(None, "Of this run the history was not kept in full.")
        ticks = camera_film.select_stills(history, rerender.valid_tick_count(history))
        population = recorded_run_range(campaign.info)
        sheet = camera_film.contact_sheet(
            rerender.render_images(file, campaign.info["seed"], shown, history, ticks, population)
        )
    except RpojaxError as error:
        return CameraSheet(None, f"The pictures cannot be taken again: {error}.")
    return CameraSheet(write_atomically(campaign.directory / "figures" / "camera.jpg", camera_film.jpeg_bytes(sheet)))


@dataclass(frozen=True)
class RunDetail:
    """The run that is shown in detail, if there is one: its figures, and for others the channels that they lack."""

    run_id: int | None
    figures: Mapping[str, Path]
    missing_channels: Mapping[str, list[str]]
    camera: CameraSheet


def _render_page(
    campaign: CampaignResults,
    content: Mapping[str, Any],
    drawn: list[dispersion_section.DrawnDistribution],
    one: RunDetail,
) -> str:
    drawings = _page_charts(campaign, content)
    return (
        _environment()
        .get_template("template.html")
        .render(
            name=campaign.info.get("name", "campaign"),
            description=campaign.info.get("description", ""),
            again=partial(shell_commands.rerun_command, campaign),
            resume=shell_commands.resume_command(campaign),
            runs=content["runs"],
            independent=content["design"]["independent"],
            scenario=section_records.scenario_lines(campaign),
            limits=content["limits"],
            page_data=_script_json({"charts": drawings.charts, "explorer": drawings.explorer}),
            plotly=Markup(get_plotlyjs()),
            **drawings.template_values,
            dispersions=drawn,
            **_table_values(campaign, content),
            **_run_detail_values(campaign, content, one),
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
    environment.filters["chance"] = format_p_value
    return environment


@dataclass(frozen=True)
class PageCharts:
    """Charts by name, data of the explorer, and what the template needs to place them."""

    charts: dict[str, Chart]
    explorer: dict[str, Any] | None
    template_values: dict[str, Any]


def _page_charts(campaign: CampaignResults, content: Mapping[str, Any]) -> PageCharts:
    curves, averages = section_records.envelope_charts(campaign), consistency_section.charts(campaign)
    bars = section_records.histogram_entries(campaign, content)
    settling = {} if content["convergence"] is None else convergence_section.charts(content["convergence"])
    explorer = dispersion_section.scatter_explorer(campaign)
    charts: dict[str, Chart] = {f"envelope-{name}": chart for name, (_, chart) in curves.items()}
    charts |= {f"average-{name}": chart for name, (_, chart) in averages.items()}
    charts |= {f"histogram-{entry['name']}": entry["chart"] for entry in bars if entry["chart"] is not None}
    charts |= {f"convergence-{name}": chart for name, (_, chart) in settling.items()}
    charts |= {f"sensitivity-{entry['metric']}": sensitivity_section.chart(entry) for entry in content["sensitivity"]}
    places = {
        "envelopes": [channel for channel, _ in curves.values()],
        "averages": [channel for channel, _ in averages.values()],
        "histograms": bars,
        "constants": [entry for entry in bars if entry["chart"] is None and entry["defined"]],
        "undefined": [entry["metric"].title for entry in bars if not entry["defined"]],
        "convergence": [(name, title) for name, (title, _) in settling.items()],
        "explorer": explorer is not None,
    }
    return PageCharts(charts, explorer, places)


def _table_values(campaign: CampaignResults, content: Mapping[str, Any]) -> dict[str, Any]:
    found = content["consistency"]
    return {
        "identity": section_records.identity_lines(campaign, content),
        "requirements": requirement_verdict_section.rows(content["requirements"]),
        "tiles": section_records.headline_tiles(content),
        "metric_rows": section_records.metric_rows(campaign, content),
        "safety": safety_section.rows(content["safety"]),
        "entries": content["safety"]["entries"]["run_ids"],
        "consistency": {
            "means": consistency_section.mean_rows(found),
            "instants": consistency_section.time_rows(found),
            "whiteness": consistency_section.whiteness_rows(found),
        },
        "sensitivity": content["sensitivity"],
        "failures": section_records.failure_table(content),
        "causes": [
            (one, failure_section.cause_rows(one), failure_section.cause_sentence(one))
            for one in content["failure_causes"]
        ],
        "faults": {"rows": fault_section.fault_rows(campaign), "headings": fault_section.headings()},
        "worst": worst_runs_section.rows(content["worst_runs"]),
    }


def _run_detail_values(campaign: CampaignResults, content: Mapping[str, Any], one: RunDetail) -> dict[str, Any]:
    return {
        "shown": one.run_id,
        "shown_metrics": [] if one.run_id is None else section_records.run_metrics(campaign, one.run_id),
        "detections": detection_section.table_cells(content["detections"]),
        "rendered": campaign.info.get("scenario", {}).get("camera", {}).get("model") == "rendered",
        "film": "" if one.camera.path is None else _data_url(one.camera.path),
        "no_film": one.camera.reason,
        "film_command": shell_commands.film_command(campaign, one.run_id),
        "figures": [(_CAPTIONS[name], _data_url(path)) for name, path in one.figures.items()],
        "left_out": [
            f"{name} is left out: of this run the channels {', '.join(channels)} were not kept."
            for name, channels in one.missing_channels.items()
        ],
    }


def _with_break_opportunities(text: str) -> Markup:
    """A name that breaks into lines after its underscores and dots, and nowhere else."""
    return Markup(re.sub(r"([_.])", r"\1<wbr>", str(escape(text))))


def _data_url(path: Path) -> str:
    kind = "jpeg" if path.suffix == ".jpg" else "png"
    return f"data:image/{kind};base64," + base64.b64encode(path.read_bytes()).decode()


def _script_json(value: Any) -> Markup:
    """JSON that cannot end the script element around it."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))
