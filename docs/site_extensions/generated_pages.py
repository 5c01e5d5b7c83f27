"""Parts of pages that are taken from the code when the site is built: tables of commands, metrics, keys and names."""

import json
from collections.abc import Iterable, Iterator
from typing import Any, ClassVar

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from site_extensions import command_help, key_table, public_names, report_shape


def setup(app: Sphinx) -> dict[str, bool]:
    """Registers the directives."""
    for part in (Commands, Metrics, Keys, ReportKeys, Scenarios, PublicNames):
        app.add_directive(part.directive, part)
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


class Metrics(GeneratedPart):
    """One table for each module of metrics: name, unit, title and meaning."""

    directive = "metrics"

    def lines(self) -> Iterator[str]:
        from rpojax.metrics import metric_catalogue

        for module in metric_catalogue.MODULES:
            heading = (module.__doc__ or "").partition(":")[0].partition(".")[0].removeprefix("Metrics of ")
            yield from (f"```{{index}} {', '.join(f'! {metric.name}' for metric in module.METRICS)}", "```", "")
            yield from (
                f"## {heading[0].upper()}{heading[1:]}",
                "",
                "| metric | unit | meaning | notes |",
                "|---|---|---|---|",
            )
            for metric in module.METRICS:
                notes = [text for text, holds in _metric_notes(metric) if holds]
                meaning = f"**{metric.title}.** {metric.meaning}".replace("|", r"\|")
                yield f"| `{metric.name}` | {metric.unit} | {meaning} | {'; '.join(notes)} |"
            yield ""


def _metric_notes(metric: Any) -> list[tuple[str, bool]]:
    return [
        ("has a derivative", metric.has_derivative),
        ("low is bad", metric.low_is_bad),
        ("of teams", metric.source == "team"),
        ("with `coverage.enabled`", metric.source == "coverage"),
        ("only inside the simulation, for tuning", metric.source == "simulation"),
    ]


class Keys(GeneratedPart):
    """One table for each section of a scenario."""

    directive = "scenario-keys"

    def lines(self) -> Iterator[str]:
        yield from key_table.lines()


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


class Scenarios(GeneratedPart):
    """Table of the packaged scenarios with their own descriptions."""

    directive = "packaged-scenarios"

    def lines(self) -> Iterator[str]:
        from rpojax.scenario.loading import scenario_loader

        yield from ("| name | mission | duration | extends |", "|---|---|---|---|")
        for name in scenario_loader.packaged_names():
            file = scenario_loader.load(name)
            base = key_table.extended(name)
            yield f"| `{name}` | {file.description} | {file.duration_s:g} s | {f'`{base}`' if base else ''} |"


class PublicNames(GeneratedPart):
    """Every public name of the package with its signature and docstring."""

    directive = "public-names"

    def lines(self) -> Iterator[str]:
        yield from public_names.lines()
