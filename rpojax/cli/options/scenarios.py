"""Options of the commands for scenario files."""

from dataclasses import dataclass
from typing import Annotated

from tyro.conf import Positional, arg

from rpojax.cli.options.arguments import AllowPlugin, AsJson, Command, Overrides, Source


@dataclass(frozen=True, kw_only=True)
class NewCommand(Command):
    """Write a commented scenario with the keys that people change first."""

    work = "scenarios.scenario:new"

    name: Annotated[Positional[str], arg(metavar="NAME", help="Name of the scenario; the file is NAME.toml.")]
    extends: Annotated[str, arg(metavar="SCENARIO", help="Packaged scenario that it extends.")] = "inspection"
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False


@dataclass(frozen=True, kw_only=True)
class ValidateCommand(Command):
    """Check a scenario without running it."""

    work = "scenarios.scenario:validate"

    scenario: Source
    overrides: Overrides = ()
    as_json: AsJson = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class SchemaCommand(Command):
    """JSON schema of a scenario, for editors and other tools."""

    work = "scenarios.schema:schema"
    prepares_jax = False

    partial: Annotated[bool, arg(help="Of a file that extends another: no key is required.")] = False
