"""Results of a sitting as a table."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

LABELS = {"batch": "batch {}", "runs": "{} runs", "precision": "{}"}
"""Figures that tell the entries of a section apart, and how they are written."""


def table(content: Mapping[str, Any]) -> "Table":
    """One row for each figure, and one for the status of a section that is not complete."""
    from rich.table import Table
    from rich.text import Text

    where = content["platform"]
    size = "small sizes" if content["small"] else "full sizes"
    title = f"{where.get('machine', 'no device')}, {size}, {content['elapsed_s']:.0f} of {content['budget_s']:.0f} s"
    found = Table(title=Text(title))
    for heading in ("section", "of", "figure"):
        found.add_column(heading, overflow="fold")
    found.add_column("value", justify="right", overflow="fold")
    for row in rows(content):
        found.add_row(*map(Text, row))
    return found


def rows(content: Mapping[str, Any]) -> Iterator[tuple[str, str, str, str]]:
    """Section, entry, figure and value of each row; lists and tables within an entry are in the JSON alone."""
    for section in content["sections"]:
        for entry in section["entries"]:
            label = ", ".join(form.format(entry[name]) for name, form in LABELS.items() if name in entry)
            for name, value in entry.items():
                if name not in LABELS and not isinstance(value, list | dict):
                    yield section["name"], label, name, format_value(value)
        if section["status"] != "measured":
            yield section["name"], "", "status", section["status"]


def format_value(value: Any) -> str:
    """A number with four digits, or the text itself."""
    if value is None:
        return "not known"
    if isinstance(value, str):
        return value
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.4g}"
