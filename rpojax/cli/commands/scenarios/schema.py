"""The command `rpojax schema`: the JSON schema of a scenario."""

from typing import Annotated

from tyro.conf import arg

from rpojax.cli.exit_status import Status
from rpojax.cli.standard_streams import print_json


def schema(*, partial: Annotated[bool, arg(help="Of a file that extends another: no key is required.")] = False) -> int:
    """JSON schema of a scenario, for editors and other tools."""
    from rpojax.scenario.schema import ScenarioFile

    content = ScenarioFile.model_json_schema()
    if partial:
        content["properties"] = {"extends": {"type": "string"}, **content["properties"]}
        for each in (content, *content["$defs"].values()):
            each.pop("required", None)
    print_json(content)
    return Status.DONE
