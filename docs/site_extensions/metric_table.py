"""All metrics as tables, one for each module of definitions: name, unit, title, meaning and notes."""

from collections.abc import Iterator
from typing import Any


def lines() -> Iterator[str]:
    """Markdown: one section with a table for each module of metrics."""
    from rpojax.metrics import metric_catalogue

    for module in metric_catalogue.MODULES:
        heading = (module.__doc__ or "").partition(":")[0].partition(".")[0].removeprefix("Metrics of ")
        yield from (f"## {heading[0].upper()}{heading[1:]}", "")
        yield from ("| metric | unit | meaning | notes |", "|---|---|---|---|")
        for metric in module.METRICS:
            notes = [text for text, holds in _notes(metric) if holds]
            meaning = f"**{metric.title}.** {metric.meaning}".replace("|", r"\|")
            yield f"| `{metric.name}` | {metric.unit} | {meaning} | {'; '.join(notes)} |"
        yield ""


def _notes(metric: Any) -> list[tuple[str, bool]]:
    return [
        ("has a derivative", metric.has_derivative),
        ("low is bad", metric.low_is_bad),
        ("of teams", metric.source == "team"),
        ("with `coverage.enabled`", metric.source == "coverage"),
        ("only inside the simulation, for tuning", metric.source == "simulation"),
    ]
