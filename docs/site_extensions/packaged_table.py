"""The packaged scenarios as a table, with their own descriptions."""

import tomllib
from collections.abc import Iterator
from importlib import resources


def lines() -> Iterator[str]:
    """Markdown: one table with a row for each packaged scenario."""
    from rpojax.scenario.loading import scenario_loader

    yield from ("| name | mission | duration | extends |", "|---|---|---|---|")
    for name in scenario_loader.packaged_names():
        file, base = scenario_loader.load(name), _extended(name)
        yield f"| `{name}` | {file.description} | {file.duration_s:g} s | {f'`{base}`' if base else ''} |"
    yield ""


def _extended(name: str) -> str | None:
    """Packaged scenario that a packaged one extends; None if it is complete by itself."""
    text = (resources.files("rpojax.scenario.packaged") / f"{name}.toml").read_text(encoding="utf-8")
    return tomllib.loads(text).get("extends")
