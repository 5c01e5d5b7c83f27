"""Parts of pages that are taken from the code when the site is built, and index entries of those that are written."""

import json
import re
from collections.abc import Iterable, Iterator
from typing import ClassVar

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from site_extensions import command_help, report_shape, written_reference


def setup(app: Sphinx) -> dict[str, bool]:
    """Registers the directives, and adds index entries."""
    for part in (Commands, ReportKeys):
        app.add_directive(part.directive, part)
    app.connect("source-read", _index)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


class GeneratedPart(SphinxDirective):
    """A directive without arguments that stands for Markdown made from the code."""

    directive: ClassVar[str]

    def lines(self) -> Iterable[str]:
        """The Markdown that takes the place of the directive."""
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        """Nodes of the Markdown; headings in it become sections of the page."""
        self.env.note_reread()  # the code may have changed though the page has not
        return self.parse_text_to_nodes("\n".join(self.lines()), allow_section_headings=True)


class Commands(GeneratedPart):
    """One section for each command, with the help that the command itself prints."""

    directive = "commands"

    def lines(self) -> Iterator[str]:
        for words, text in command_help.helps():
            yield from (f"### `rpojax {words}`", "", "```text", *text.splitlines(), "```", "")


class ReportKeys(GeneratedPart):
    """Every key of report.json with its type, from the shape of real reports."""

    directive = "report-keys"

    def lines(self) -> Iterator[str]:
        self.env.note_dependency(str(report_shape.FILE))
        part = None
        for key, form in json.loads(report_shape.FILE.read_text(encoding="utf-8")).items():
            if key.partition(".")[0].rstrip("[]") != part:
                part = key.partition(".")[0].rstrip("[]")
                yield from ("", f"## `{part}`", "", report_shape.purpose(part), "", "| key | type |", "|---|---|")
            yield f"| `{key}` | {form} |"


def _index(app: Sphinx, page: str, source: list[str]) -> None:
    """Adds index entries, which the search prefers, for the names in tables and headings of written pages."""
    if f"{page.rpartition('/')[2]}.md" in written_reference.PARTS:
        source[0] = re.sub(r"^##.*\n(?:(?!##).*\n)*", _with_entries, source[0], flags=re.MULTILINE)


def _with_entries(section: re.Match[str]) -> str:
    """A section of Markdown with index entries above its heading."""
    names = re.findall(r"^(?:\| |### )`([^`]+)`", section[0], re.MULTILINE)
    words = ", ".join(f"! {name.removeprefix('rpojax.')}" for name in names)
    return f"```{{index}} {words}\n```\n\n{section[0]}" if words else section[0]
