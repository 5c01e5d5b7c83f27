"""The command `rpojax status`: how far a campaign is."""

from rpojax.campaign.status import status as look
from rpojax.cli import console
from rpojax.cli.exit_status import Status
from rpojax.cli.options.campaigns import StatusCommand
from rpojax.cli.standard_streams import print_json


def status(asked: StatusCommand) -> int:
    """Does the work of the command; returns its exit status."""
    found = look(asked.directory)
    if asked.as_json:
        print_json(found)
    else:
        console.show_status(found)
    return Status.DONE
