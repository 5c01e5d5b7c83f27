"""The commands `rpojax new` and `rpojax validate`: a commented scenario file to begin with, and the check of one."""

import re
from pathlib import Path

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.cli.exit_status import Status
from rpojax.cli.options.scenarios import NewCommand, ValidateCommand
from rpojax.cli.output_paths import claim
from rpojax.cli.scenario_files import load
from rpojax.cli.standard_streams import print_json
from rpojax.errors import RpojaxError
from rpojax.scenario.dispersed_numbers import dispersion_keys
from rpojax.scenario.loading.scenario_loader import packaged_names
from rpojax.scenario.loading.scenario_template import template
from rpojax.scenario.loading.scenario_warnings import scenario_warnings
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.team.members import member_names
from rpojax.scenario.trained.coverage_surface import surface_triangles


def new(asked: NewCommand) -> int:
    """Does the work of the command; returns its exit status."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}", asked.name):
        raise RpojaxError.of_argument("name", f"found {asked.name!r:.60}, expected letters, digits, - and _")
    path = Path(f"{asked.name}.toml")
    claim(path, asked.force)

    if asked.name in packaged_names() or asked.extends not in packaged_names():
        expected = "a name that no packaged scenario has" if asked.name in packaged_names() else "a packaged scenario"
        argument, found = ("name", asked.name) if asked.name in packaged_names() else ("extends", asked.extends)
        raise RpojaxError.of_argument(argument, f"found {found!r}, expected {expected}")
    print(write_atomically(path, template(asked.name, asked.extends, load(asked.extends, ())).encode()))
    return Status.DONE


def validate(asked: ValidateCommand) -> int:
    """Does the work of the command; returns its exit status."""
    file = load(asked.scenario, asked.overrides)
    if file.coverage.enabled:
        surface_triangles(file.model_dump())
    content = {
        "name": file.name,
        "description": file.description,
        "duration_s": file.duration_s,
        "scenario_hash": scenario_digest(file),
        "dispersions": dispersion_keys.varied_keys(file),
        "design": file.design.kind,
        "servicers": list(member_names(file)),
        "warnings": scenario_warnings(file),
    }
    if asked.as_json:
        print_json(content)
    else:
        print(f"{file.name}: valid; {file.duration_s:g} s, {len(file.dispersions)} dispersions")
        if file.servicers:
            print(f"servicers: {', '.join(member_names(file))}")
        for warning in content["warnings"]:
            print(f"warning: {warning}")
    return Status.DONE
