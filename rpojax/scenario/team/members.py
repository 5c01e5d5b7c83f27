"""Servicers of a team as scenarios and parameters of one servicer each."""

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from rpojax.errors import ScenarioError, ServicerError
from rpojax.scenario.checks.validation_errors import did_you_mean, first_error
from rpojax.scenario.params import Params, build_params
from rpojax.scenario.schema import ScenarioFile, ServicerChanges


def member_names(file: ScenarioFile) -> tuple[str, ...]:
    """Names of the servicers of a team, none of a servicer alone."""
    return tuple(changes.name for changes in file.servicers)


def member_files(file: ScenarioFile) -> tuple[ScenarioFile, ...]:
    """Scenario of each servicer of a team, itself without a team; the scenario itself of a servicer alone.

    Raises:
        ServicerError: naming the key that does not suit a servicer, what was found and what was expected.
    """
    if not file.servicers:
        return (file,)
    tables = {**file.model_dump(), "servicers": []}
    return tuple(_member(type(file), tables, changes) for changes in file.servicers)


def member_params(file: ScenarioFile) -> tuple[Params, ...]:
    """Parameters of each servicer of a team, or of a servicer alone."""
    members = member_files(file)
    return tuple(build_params(each.model_dump(), each.camera.width_px, each.camera.height_px) for each in members)


def refuse_team(file: ScenarioFile, purpose: str) -> None:
    """Refuses a team for a `purpose` that knows one servicer alone.

    Raises:
        ScenarioError: the scenario has several servicers.
    """
    if file.servicers:
        raise ScenarioError("servicers", len(file.servicers), f"a scenario without [[servicers]] for {purpose}")


def _member(schema: type[ScenarioFile], tables: dict[str, Any], changes: ServicerChanges) -> ScenarioFile:
    try:
        return schema.model_validate(_with_changes(tables, changes.tables))
    except ValidationError as error:
        raise ServicerError(changes.name, first_error(error, tables)) from None
    except ScenarioError as error:
        raise ServicerError(changes.name, error) from None


def _with_changes(tables: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of a scenario with what differs for one servicer, in phases and faults by their name."""
    lists = {}
    for of_list, what in (("faults", "fault"), ("phases", "phase")):
        own = changes.get(of_list, {})
        names = [each["name"] for each in tables[of_list]]
        for name in own:
            if name not in names:
                raise ScenarioError(of_list, name, f"the name of a {what} of the scenario{did_you_mean(name, names)}")
        lists[of_list] = [_merged(each, own.get(each["name"], {})) for each in tables[of_list]]
    return _merged(tables, {**changes, **lists})


def _merged(table: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(table)
    for key, value in changes.items():
        old = table.get(key)
        merged[key] = _merged(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return merged
