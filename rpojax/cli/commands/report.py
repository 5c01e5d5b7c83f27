"""The command `rpojax report`: writes the report of a campaign anew."""

from typing import Annotated

from tyro.conf import arg

from rpojax.cli.arguments import AsJson, Folder, NoFilm
from rpojax.cli.campaign_output import show_results, write_brief_report, write_campaign_report
from rpojax.cli.exit_status import Status
from rpojax.runtime.jax_environment import prepare_jax


def report(
    directory: Folder,
    *,
    run_id: Annotated[
        int | None, arg(metavar="I", help="Run to show in detail.", help_behavior_hint="(default: the median one)")
    ] = None,
    brief: Annotated[bool, arg(help="Write brief.html instead: four A4 pages to print.")] = False,
    no_film: NoFilm = False,
    as_json: AsJson = False,
) -> int:
    """Write report.html, report.json and figures again, or a brief report to print."""
    prepare_jax(cache=True)
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.report.page.run_selection import choose_run

    found = Campaign(directory)
    choose_run(found, run_id)
    if brief:
        show_results(found, lambda: write_brief_report(found, as_json, run_id), as_json)
        return Status.DONE
    show_results(found, lambda: write_campaign_report(found, as_json, not no_film, run_id), as_json)
    return Status.DONE
