"""Shell commands shown in the report, ready to be copied."""

import shlex

from rpojax.report.campaign_results import CampaignResults


def rerun_command(campaign: CampaignResults, run: int | str, out: str) -> str:
    """Command that repeats one run with full history; a Python call if stages were replaced."""
    if campaign.info.get("stages"):
        folder = f"rpojax.Campaign({str(campaign.directory)!r})"
        return f"rpojax.campaign.rerun.rerun({folder}, {run}, pathlib.Path({out!r}), stages=...)"
    return f"rpojax rerun {shlex.quote(str(campaign.directory))} --run-id {run} --out {out}"


def resume_command(campaign: CampaignResults) -> str:
    """Command that simulates the missing runs of a campaign and rewrites its report."""
    return f"rpojax resume {shlex.quote(str(campaign.directory))}"


def film_command(campaign: CampaignResults, run: int | None) -> str:
    """Command that makes a film of the camera images of a run."""
    return f"rpojax film {shlex.quote(str(campaign.directory))} --run-id {run} --out film.mp4"
