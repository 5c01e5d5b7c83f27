"""The command `rpojax validate`: the check of a scenario."""

from rpojax.cli.exit_status import Status
from rpojax.cli.options.scenarios import ValidateCommand
from rpojax.cli.scenario_files import load
from rpojax.cli.standard_streams import print_json
from rpojax.scenario.dispersed_numbers import dispersion_keys
from rpojax.scenario.loading.scenario_warnings import scenario_warnings
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.team.members import member_names
from rpojax.scenario.trained.coverage_surface import is_surface_used, surface_triangles


def validate(asked: ValidateCommand) -> int:
    """Does the work of the command; returns its exit status."""
    file = load(asked.scenario, asked.overrides)
    if is_surface_used(file.model_dump()):
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
