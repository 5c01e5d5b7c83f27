"""The command `rpojax schema`: the JSON schema of a scenario."""

from rpojax.cli.exit_status import Status
from rpojax.cli.options.scenarios import SchemaCommand
from rpojax.cli.standard_streams import print_json
from rpojax.scenario.schema import ScenarioFile


def schema(asked: SchemaCommand) -> int:
    """Does the work of the command; returns its exit status."""
    content = ScenarioFile.model_json_schema()
    if asked.partial:
        content["properties"] = {"extends": {"type": "string"}, **content["properties"]}
        for each in (content, *content["$defs"].values()):
            each.pop("required", None)
    print_json(content)
    return Status.DONE
