"""The command `rpojax report`: writes the report of a campaign anew."""

from pathlib import Path

from rpojax.campaign.requirement_revision import change_requirements
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli.campaign_output import keeping_results, show_results, write_brief_report, write_campaign_report
from rpojax.cli.exit_status import Status
from rpojax.cli.options.output import ReportCommand
from rpojax.errors import RpojaxError
from rpojax.report.page.detail_values import choose_run


def report(asked: ReportCommand) -> int:
    """Does the work of the command; returns its exit status."""
    found = Campaign(asked.directory)
    found.verify()
    if asked.requirements is not None:
        found = change_requirements(found, asked.requirements, asked.reason)
    elif asked.reason:
        raise RpojaxError.of_argument("reason", "found without --requirements, expected both or neither")
    choose_run(found, asked.run_id)

    def write() -> Path:
        if asked.brief:
            return write_brief_report(found, asked.as_json, asked.run_id)
        return write_campaign_report(found, asked.as_json, not asked.no_film, asked.run_id)

    with keeping_results(asked.directory):
        show_results(found, write, asked.as_json)
    return Status.DONE
