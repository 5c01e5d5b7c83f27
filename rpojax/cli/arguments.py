"""Command-line arguments that commands share."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, UseAppendAction, arg

if TYPE_CHECKING:
    from rpojax.scenario.schema import ScenarioFile


Source = Annotated[Positional[str], arg(metavar="SCENARIO", help="Packaged name or TOML file.")]
Folder = Annotated[Positional[Path], arg(metavar="DIR", help="Folder of a campaign.")]
Out = Annotated[Path, arg(metavar="DIR", help="Folder to make for the results.")]
Overrides = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(name="set", metavar="KEY=VALUE", help="Another value for a key of the scenario, in TOML; several may follow."),
]
Seed = Annotated[int, arg(metavar="S", help="Master seed.")]
Force = Annotated[bool, arg(help="Replace the folder if it holds a campaign.")]
AsJson = Annotated[bool, arg(name="json", help="JSON on stdout and no progress.")]
NoFilm = Annotated[bool, arg(help="Take no pictures of a rendered camera again for the report.")]
NoCache = Annotated[bool, arg(help="Compile anew and keep nothing of it.")]


def load(source: str, overrides: Sequence[str]) -> "ScenarioFile":
    """Scenario with its overrides."""
    from rpojax.scenario import scenario_file

    return scenario_file.load(source, overrides)
