"""The command `rpojax report`: writes the report of a campaign anew."""

from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from rpojax.cli.arguments import AsJson, Folder, NoFilm
from rpojax.cli.campaign_output import keeping_results, show_results, write_brief_report, write_campaign_report
from rpojax.cli.exit_status import Status
from rpojax.errors import RpojaxError
from rpojax.runtime.jax_environment import prepare_jax


def report(
    directory: Folder,
    *,
    run_id: Annotated[
        int | None, arg(metavar="I", help="Run to show in detail.", help_behavior_hint="(default: the median one)")
    ] = None,
    requirements: Annotated[
        Path | None,
        arg(metavar="FILE", help="Judge by the [[requirements]] of this TOML file from now on; the report says so."),
    ] = None,
    reason: Annotated[str, arg(metavar="TEXT", help="Why requirements change.")] = "",
    brief: Annotated[bool, arg(help="Write brief.html instead: four A4 pages to print.")] = False,
    no_film: NoFilm = False,
    as_json: AsJson = False,
) -> int:
    """Write report.html, report.json and figures again, or a brief report to print."""
    prepare_jax(cache=True)
    from rpojax.campaign.requirement_revision import change_requirements
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.report.page.detail_values import choose_run

    found = Campaign(directory)
    found.verify()
    if requirements is not None:
        found = change_requirements(found, requirements, reason)
    elif reason:
        raise RpojaxError.of_argument("reason", "found without --requirements, expected both or neither")
    choose_run(found, run_id)

    def write() -> Path:
        if brief:
            return write_brief_report(found, as_json, run_id)
        return write_campaign_report(found, as_json, not no_film, run_id)

    with keeping_results(directory):
        show_results(found, write, as_json)
    return Status.DONE
