"""The page on one estimated probability of failure."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.report import rare_failures
from rpojax.report.page import page_templates

PAGE_NAME = "probability.html"


def write_page(content: Mapping[str, Any], directory: Path) -> Path:
    """Writes the page of one estimate into its folder, and returns its path.

    Raises:
        OutputError: it cannot be written.
    """
    charts = rare_failures.charts(content)
    values = {
        "name": content["scenario"],
        "each": rare_failures.estimate_values(content, charts),
        "identity": _identity(content, directory),
        "foot": page_templates.foot_text({**content, "name": content["scenario"]}),
    }
    data = {"charts": {chart.name: chart.chart for chart in charts}}
    page = page_templates.render("probability.html", data, values)
    return write_atomically(directory / PAGE_NAME, page.encode("utf-8", "backslashreplace"))


def _identity(content: Mapping[str, Any], directory: Path) -> list[tuple[str, str]]:
    return [
        ("Folder", str(directory)),
        ("Scenario", f"{content['scenario']}, hash {content['scenario_hash']}"),
        ("Seed", str(content["seed"])),
        ("Runs", f"{content['evaluations']} by method {content['method']}"),
    ]
