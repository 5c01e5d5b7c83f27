"""The page on a study of faults."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.report import survived_faults
from rpojax.report.labels import format_number
from rpojax.report.page import page_templates

PAGE_NAME: Final = "faults.html"
_MOST_COMMANDS: Final = 200
"""Most worst runs with their commands on the page; faults.json has all."""


def write_page(content: Mapping[str, Any], directory: Path) -> None:
    """Writes the page of a study into a folder.

    Raises:
        OutputError: it cannot be written.
    """
    worst = survived_faults.worst_first(content)
    values = {
        **page_templates.study_values(
            "Faults",
            {"survived": "Survived", "worst": "Worst runs"},
            content["study"],
            survived_faults.sentences(content),
            directory,
            each="fault and time",
        ),
        "headings": survived_faults.headings(content),
        "rows": [(name, list(map(_cell, cells))) for name, cells in survived_faults.by_title(content).items()],
        "nominal": _cell(content["nominal"]),
        "worst": list(map(_worst, worst[:_MOST_COMMANDS])),
        "more": max(0, len(worst) - _MOST_COMMANDS),
    }
    page = page_templates.render("faults.html", {"charts": {}}, values)
    write_atomically(directory / PAGE_NAME, page.encode("utf-8", "backslashreplace"))


def _cell(cell: Mapping[str, Any]) -> dict[str, Any]:
    """What the table by time shows of a cell."""
    return {
        "share": f"{cell['survived_share']:.3f}",
        "text": survived_faults.share(cell),
        "margin": survived_faults.margin(cell),
        "completed": survived_faults.completed(cell),
        "interval": survived_faults.interval(cell),
    }


def _worst(cell: Mapping[str, Any]) -> dict[str, Any]:
    """What the table of worst runs shows of a cell."""
    others = [f"{kind.replace('_', ' ')} {number}" for kind, number in cell["outcomes"].items()]
    return {
        **_cell(cell),
        "title": cell["title"],
        "time": f"{format_number(cell['time_s'])} s",
        "outcomes": ", ".join(others),
        "binding": survived_faults.binding(cell),
        "clearance": survived_faults.clearance(cell),
        "run": cell["worst_run"],
        "outcome": cell["worst_outcome"].replace("_", " "),
        "command": cell.get("replay", ""),
    }
