"""The page on a study of robustness, and its picture."""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpojax.analysis.robustness.study import STUDY
from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.report import robust_margins
from rpojax.report.figures.margin_bars import margin_bars
from rpojax.report.page import page_templates

PAGE_NAME, PICTURE_NAME = "robustness.html", "robustness.png"


def write_page(content: Mapping[str, Any], directory: Path) -> None:
    """Writes the page of a study and its picture into a folder.

    Raises:
        OutputError: they cannot be written.
    """
    study, rows = content[STUDY], robust_margins.rows(content)
    picture = margin_bars(study["scenario"], rows)
    write_atomically(directory / PICTURE_NAME, picture)
    values = {
        **page_templates.study_values(
            "Robustness",
            {"margins": "Margins", "confidence": "Confidence"},
            study,
            robust_margins.sentences(content),
            directory,
            each="step",
        ),
        "picture": f"data:image/png;base64,{base64.b64encode(picture).decode()}",
        "headings": robust_margins.HEADINGS,
        "rows": rows,
    }
    page = page_templates.render("robustness.html", {"charts": {}}, values)
    write_atomically(directory / PAGE_NAME, page.encode("utf-8", "backslashreplace"))
