"""Scenario files of a command line, with what is said about them on stderr."""

from collections.abc import Mapping, Sequence
from typing import Any

from rpojax.cli.console import show_lines
from rpojax.runtime.jax_environment import set_loop_fusion_flag
from rpojax.runtime.warning_lines import warnings_as_lines
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.loading.format_migration import FormatChangeWarning
from rpojax.scenario.loading.scenario_warnings import scenario_warnings, unused_key_warnings
from rpojax.scenario.schema import ScenarioFile


def load(source: str, overrides: Sequence[str], rendered: bool | None = None) -> ScenarioFile:
    """Scenario file of a packaged name or path, with overrides `KEY=VALUE`; says on stderr what a migration changed.

    Compiler flags are set for its runs before it is checked, since a check may be the first computation. `rendered`
    says whether most of the work is rendering, None that it depends on the camera of the scenario.
    """
    with warnings_as_lines(FormatChangeWarning):
        reading = scenario_loader.read(source, overrides)
        if rendered is None:
            fuse_loops_of(reading.tables)
        else:
            set_loop_fusion_flag(rendered)
        return reading.scenario()


def fuse_loops_of(tables: Mapping[str, Any]) -> None:
    """Sets compiler flags for the runs of a scenario with these tables, which are not checked yet."""
    camera = tables.get("camera")
    set_loop_fusion_flag(rendered=isinstance(camera, Mapping) and camera.get("model") == "rendered")


def show_warnings(file: ScenarioFile, quiet: bool) -> None:
    """Prints on stderr why the mission may not work as the scenario declares it, unless `quiet`."""
    show_lines([] if quiet else scenario_warnings(file))


def show_unused_keys(file: ScenarioFile, quiet: bool, but: str = " ") -> None:
    """Prints on stderr which keys were given and have no effect in the scenario, unless `quiet`.

    Keys that begin with `but` are those to which the command gives an effect.
    """
    show_lines(line for line in ([] if quiet else unused_key_warnings(file)) if not line.startswith(but))
