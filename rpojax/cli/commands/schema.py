"""The command `rpojax schema`: the JSON schema of a scenario."""

from typing import TYPE_CHECKING

from rpojax.cli.console import print_json
from rpojax.cli.exit_status import Status

if TYPE_CHECKING:
    pass


def schema() -> int:
    """JSON schema of a scenario, for editors and other tools."""
    from rpojax.scenario.schema import ScenarioFile

    print_json(ScenarioFile.model_json_schema())
    return Status.DONE
