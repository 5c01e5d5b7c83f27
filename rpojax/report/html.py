"""One self-contained page and its JSON twin for a campaign."""

import base64
import json
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape
from plotly.offline import get_plotlyjs

from rpojax.errors import OutputError, RpojaxError
from rpojax.report import detections, dispersions, faults, sections
from rpojax.report.charts import Chart
from rpojax.report.figures import lacking, write_figures
from rpojax.report.files import write_atomically
from rpojax.report.labels import number
from rpojax.report.results import Results
from rpojax.report.summary import choose_run, summarise

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


def write_report(campaign: Results, run_id: int | None = None, film: bool = True) -> Path:
    """Writes report.html, report.json and the figures of one run into the campaign's folder; returns the page's path.

    `run_id` chooses the run shown in detail (default: the median one in formation error among kept histories), `film`
    whether to take pictures of its rendered camera again, which costs some 20 s. Raises ResultError where no history of
    `run_id` is kept.
    """
    shown = choose_run(campaign, run_id)
    summary = summarise(campaign)
    _refuse_links(campaign.directory / "figures")
    figures: dict[str, Path] = {}
    left_out: dict[str, list[str]] = {}
    if shown is not None:
        title = f"{campaign.info.get('name', 'campaign')}, run {shown}"
        history = campaign.history(shown)
        figures, left_out = write_figures(history, campaign.directory / "figures", title), lacking(history)
    lines = detections.by_range(campaign.history(run) for run in sorted(campaign.history_ids))
    seen = _film(campaign, shown) if film else Seen(None, "It was left out by --no-film.")
    page = _page(campaign, summary, shown, figures, left_out, lines, seen)
    content = json.dumps({**summary, "detections": lines}, indent=2, allow_nan=False) + "\n"
    write_atomically(campaign.directory / "report.json", content.encode())
    return write_atomically(campaign.directory / "report.html", page.encode())


def _refuse_links(folder: Path) -> None:
    """Refuses a folder for figures that leads elsewhere."""
    if folder.is_symlink():
        raise OutputError(f"{folder}: found a link that leads elsewhere, expected a folder of the campaign")


@dataclass(frozen=True)
class Seen:
    """Strip of what a camera saw, or why there is none."""

    strip: Path | None
    reason: str = ""


def _film(campaign: Results, shown: int | None) -> Seen:
    if shown is None:
        return Seen(None, "No full history was kept.")
    # Here, because it takes what a simulation takes.
    from rpojax.campaign import filming
    from rpojax.campaign.design import population_of
    from rpojax.report import film

    if campaign.info["scenario"].get("camera", {}).get("model") != "rendered":
        return Seen(None, "The scenario's camera takes no pictures.")
    try:
        file = filming.scenario_of(campaign.info)
        history = campaign.history(shown)
        if not filming.can_show(history, file):
            return Seen(None, "Of this run the history was not kept in full.")
        ticks = film.stills(history, filming.last_tick(history))
        population = population_of(campaign.info)
        sheet = film.strip(filming.pictures(file, campaign.info["seed"], shown, history, ticks, population))
    except RpojaxError as error:
        return Seen(None, f"The pictures cannot be taken again: {error}.")
    return Seen(write_atomically(campaign.directory / "figures" / "camera.jpg", film.jpeg(sheet)))


def _page(
    campaign: Results,
    summary: Mapping[str, Any],
    shown: int | None,
    figures: Mapping[str, Path],
    left_out: Mapping[str, list[str]],
    lines: list[dict[str, Any]],
    seen: Seen,
) -> str:
    folder = jinja2.FileSystemLoader(Path(__file__).parent)
    environment = jinja2.Environment(
        loader=folder, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["number"] = number
    environment.filters["breakable"] = _breakable
    curves = sections.envelopes(campaign)
    bars = sections.histograms(campaign, summary)
    charts: dict[str, Chart] = {f"envelope-{name}": chart for name, (_, chart) in curves.items()}
    charts.update({f"histogram-{entry['name']}": entry["chart"] for entry in bars if entry["chart"] is not None})
    explorer = dispersions.explorer(campaign)
    return environment.get_template("template.html").render(
        name=campaign.info.get("name", "campaign"),
        description=campaign.info.get("description", ""),
        again=partial(sections.again, campaign),
        resume=f"rpojax resume {shlex.quote(str(campaign.directory))}",
        runs=summary["runs"],
        identity=sections.identity(campaign, summary),
        tiles=sections.tiles(summary),
        metric_rows=sections.metric_rows(campaign, summary),
        envelopes=[channel for channel, _ in curves.values()],
        consistency=sections.consistency(campaign, summary),
        histograms=bars,
        constants=[entry for entry in bars if entry["chart"] is None and entry["defined"]],
        undefined=[entry["metric"].title for entry in bars if not entry["defined"]],
        dispersions=dispersions.as_drawn(campaign),
        explorer=explorer is not None,
        failures=sections.failures(summary),
        faults={"rows": faults.by_kind(campaign), "headings": faults.headings()},
        shown=shown,
        shown_metrics=[] if shown is None else sections.chosen_metrics(campaign, shown),
        detections=detections.rows(lines),
        rendered=campaign.info.get("scenario", {}).get("camera", {}).get("model") == "rendered",
        film="" if seen.strip is None else _data_url(seen.strip),
        no_film=seen.reason,
        film_command=f"rpojax film {shlex.quote(str(campaign.directory))} --run-id {shown} --out film.mp4",
        figures=[(_CAPTIONS[name], _data_url(path)) for name, path in figures.items()],
        left_out=[
            f"{name} is left out: of this run the channels {', '.join(channels)} were not kept."
            for name, channels in left_out.items()
        ],
        scenario=sections.scenario_lines(campaign),
        limits=sections.limits(campaign, summary),
        page_data=_script_json({"charts": charts, "explorer": explorer}),
        plotly=Markup(get_plotlyjs()),
    )


def _breakable(text: str) -> Markup:
    """A name that breaks into lines after its underscores and dots, and nowhere else."""
    return Markup(re.sub(r"([_.])", r"\1<wbr>", str(escape(text))))


def _data_url(path: Path) -> str:
    kind = "jpeg" if path.suffix == ".jpg" else "png"
    return f"data:image/{kind};base64," + base64.b64encode(path.read_bytes()).decode()


def _script_json(value: Any) -> Markup:
    """JSON that cannot end the script element around it."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))
