"""The command `rpojax export`: results or trajectories of a campaign in files that other tools read."""

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli.exit_status import Status
from rpojax.cli.options.output import ExportCommand
from rpojax.cli.standard_streams import print_json
from rpojax.interop import export as exports
from rpojax.runtime.progress import run_progress


def export(asked: ExportCommand) -> int:
    """Does the work of the command; returns its exit status."""
    found = Campaign(asked.directory)
    names = None if asked.what is None else tuple(name.strip() for name in asked.what.split(",") if name.strip())
    options = exports.ExportOptions(tables=names, run_id=asked.run_id, force=asked.force)
    with run_progress(found.file.duration_s, quiet=asked.as_json) as watch:
        paths = exports.export_as(found, asked.out, asked.form, options, watch)
    if asked.as_json:
        print_json({"files": list(map(str, paths))})
    else:
        for path in paths:
            print(path)
    return Status.DONE
