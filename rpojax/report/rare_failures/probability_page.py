"""Section of the campaign's report on rare failures, and the page of one estimate."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.report.rare_failures import probability_rows

PAGE_NAME = "probability.html"


def section(entries: Sequence[Mapping[str, Any]]) -> Markup:
    """Section of the campaign's report as HTML, empty without entries."""
    if not entries:
        return Markup("")
    estimates = [
        {**_values(entry["estimate"]), "same_scenario": entry["same_scenario"]}
        for entry in entries
        if entry["kind"] == "estimate"
    ]
    wanted = [entry for entry in entries if entry["kind"] == "wanted"]
    return Markup(_environment().get_template("section.html").render(estimates=estimates, wanted=wanted))


def write_page(content: Mapping[str, Any], directory: Path) -> Path:
    """Writes the page of one estimate into its folder, and returns its path.

    Raises:
        OutputError: it cannot be written.
    """
    page = _environment().get_template("page.html").render(name=content["scenario"], **_values(content))
    return write_atomically(directory / PAGE_NAME, page.encode("utf-8", "backslashreplace"))


def _values(content: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "title": content["failure"]["words"],
        "trusted": content["trusted"],
        "sentences": probability_rows.sentences(content)[1:],
        "headline": probability_rows.sentences(content)[0],
        "levels": probability_rows.level_rows(content["levels"]),
        "points": probability_rows.design_point_rows(content["design_points"]),
        "runs": probability_rows.failing_run_rows(content["failing_runs"]),
        "noise": content["noise"],
        "unmapped": content["unmapped"],
    }


def _environment() -> jinja2.Environment:
    here = Path(__file__).parent
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader([here / "templates", here.parent / "page" / "assets"]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
