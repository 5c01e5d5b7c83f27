"""The command `rpojax status`: how far a campaign is."""

from typing import TYPE_CHECKING

from rpojax.cli import console
from rpojax.cli.arguments import AsJson, Folder
from rpojax.cli.exit_status import Status
from rpojax.cli.standard_streams import print_json

if TYPE_CHECKING:
    pass


def status(directory: Folder, *, as_json: AsJson = False) -> int:
    """Progress of a campaign: blocks, runs, failures and speed so far; also while it is running."""
    from rpojax.campaign.status import status as look

    found = look(directory)
    if as_json:
        print_json(found)
    else:
        console.show_status(found)
    return Status.DONE
