"""The command `rpojax validate`: checks a scenario without running it."""

from typing import TYPE_CHECKING

from rpojax.cli.arguments import AsJson, Overrides, Source, load
from rpojax.cli.exit_status import Status
from rpojax.cli.standard_streams import print_json

if TYPE_CHECKING:
    pass


def validate(scenario: Source, *, overrides: Overrides = (), as_json: AsJson = False) -> int:
    """Check a scenario without running it."""
    from rpojax.scenario.dispersed_numbers import dispersion_keys
    from rpojax.scenario.loading.scenario_warnings import scenario_warnings
    from rpojax.scenario.scenario_digest import scenario_digest
    from rpojax.scenario.team.members import member_names
    from rpojax.scenario.trained.coverage_surface import surface_triangles

    file = load(scenario, overrides)
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
    if as_json:
        print_json(content)
    else:
        print(f"{file.name}: valid; {file.duration_s:g} s, {len(file.dispersions)} dispersions")
        if file.servicers:
            print(f"servicers: {', '.join(member_names(file))}")
        for warning in content["warnings"]:
            print(f"warning: {warning}")
    return Status.DONE
