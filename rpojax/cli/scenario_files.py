"""Scenario files of a command line, with what is said about them on stderr."""

import sys
from collections.abc import Sequence
from pathlib import Path

from rpojax.analysis.statistics import rare_requirements
from rpojax.cli.console import show_lines
from rpojax.runtime.jax_environment import set_loop_fusion_flag
from rpojax.runtime.warning_lines import warnings_as_lines
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.loading.format_migration import FormatChangeWarning
from rpojax.scenario.loading.scenario_warnings import scenario_warnings, unused_key_warnings
from rpojax.scenario.schema import ScenarioFile


def load(source: str, overrides: Sequence[str]) -> ScenarioFile:
    """Scenario file of a packaged name or path, with overrides `KEY=VALUE`; says on stderr what a migration changed."""
    with warnings_as_lines(FormatChangeWarning):
        return scenario_loader.load(source, overrides)


def load_to_simulate(source: str, overrides: Sequence[str], quiet: bool) -> ScenarioFile:
    """Scenario file as `load` gives it, whose unused keys are shown, and with compiler flags set for its runs."""
    file = load(source, overrides)
    show_unused_keys(file, quiet)
    set_loop_fusion_flag(rendered=file.camera.model == "rendered")
    return file


def show_warnings(file: ScenarioFile, quiet: bool) -> None:
    """Prints on stderr why the mission may not work as the scenario declares it, unless `quiet`."""
    show_lines([] if quiet else scenario_warnings(file))


def show_unused_keys(file: ScenarioFile, quiet: bool) -> None:
    """Prints on stderr which keys were given and have no effect in the scenario, unless `quiet`."""
    show_lines([] if quiet else unused_key_warnings(file))


def show_rare_requirements(file: ScenarioFile, out: Path, quiet: bool) -> None:
    """Prints on stderr which requirements take more plain runs than is practical, and the command that serves them.

    It takes the copy of the scenario in the folder of the campaign, `out`, which has all that was set by `--set`.
    """
    for each in [] if quiet else file.requirements:
        if rare_requirements.is_rare(each.probability) and each.is_of_all_runs:
            runs = rare_requirements.plain_runs(each.probability, each.consumer_risk)
            line = (
                f"rpojax: {each.metric} {each.bound} {each.limit:g} with probability {each.probability:.9g} takes "
                f"{runs:,} plain runs without a violation"
            )
            if rare_requirements.can_be_estimated(each.metric, len(file.servicers)):
                place = out / "probability" / each.metric
                command = rare_requirements.command(out / "scenario.toml", each.metric, place, file.plugin)
                line += f"; instead, after the campaign: {command}"
            print(line, file=sys.stderr)
