"""Command-line arguments that commands share."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, UseAppendAction, arg

from rpojax.runtime.warning_lines import warnings_as_lines

if TYPE_CHECKING:
    from rpojax.scenario.schema import ScenarioFile


FLAT = arg(name="")
"""Marks a record of options: its fields are options of the command, without a prefix."""

Source = Annotated[Positional[str], arg(metavar="SCENARIO", help="Packaged name or TOML file.")]
Folder = Annotated[Positional[Path], arg(metavar="DIR", help="Folder of a campaign.")]
Out = Annotated[Path, arg(metavar="DIR", help="Folder to create for the results.")]
Overrides = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(name="set", metavar="KEY=VALUE", help="Override a key of the scenario, in TOML."),
]
Seed = Annotated[int, arg(metavar="S", help="Master seed.")]
Force = Annotated[bool, arg(help="Replace the folder if it holds a campaign.")]
AsJson = Annotated[bool, arg(name="json", help="JSON on stdout and no progress.")]
NoFilm = Annotated[bool, arg(help="Do not render the camera of a run again for the report.")]
NoCache = Annotated[bool, arg(help="Compile anew, without the cache of compiled programs.")]


@dataclass(frozen=True)
class Session:
    """How a command computes and prints."""

    as_json: AsJson = False
    no_cache: NoCache = False


def load(source: str, overrides: Sequence[str]) -> "ScenarioFile":
    """Scenario file of a packaged name or path, with overrides `KEY=VALUE`; says on stderr what a migration changed."""
    from rpojax.scenario.loading import scenario_loader
    from rpojax.scenario.loading.format_migration import FormatChangeWarning

    with warnings_as_lines(FormatChangeWarning):
        return scenario_loader.load(source, overrides)
