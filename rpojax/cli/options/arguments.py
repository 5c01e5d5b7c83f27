"""What records of options share: the base of all, and options that several commands have."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from tyro.conf import Positional, UseAppendAction, arg

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
AllowPlugin = Annotated[
    bool, arg(help="Execute the plugin that the scenario names: Python code with the rights of this program.")
]
NoCache = Annotated[bool, arg(help="Compile anew, without the cache of compiled programs.")]


@dataclass(frozen=True)
class Session:
    """How a command computes and prints."""

    as_json: AsJson = False
    no_cache: NoCache = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class Command:
    """Options of a command; the docstring of a subclass is the command's help."""

    work: ClassVar[str]
    """Function that gets this record and returns the exit status, as 'module:function' below `rpojax.cli.commands`."""
    prepares_jax: ClassVar[bool] = True
    """Whether JAX is prepared before the function is imported."""
    has_small_matrices: ClassVar[bool] = False
    """Whether threads of the linear algebra would only wait for each other."""
    keeps_programs: ClassVar[bool] = True
    """Whether compiled programs are kept in the cache folder, unless `--no-cache` is given."""


@dataclass(frozen=True)
class Group:
    """Commands with a name in common, such as `field`, by the name of each; `help` describes them together."""

    help: str
    commands: Mapping[str, type[Command]]
