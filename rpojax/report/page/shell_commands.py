"""Commands that a reader of the report may want to copy."""

import shlex

from rpojax.report.campaign_results import CampaignResults


def rerun_command(campaign: CampaignResults, run: int | str, out: str) -> str:
    """Command that flies one run again, bit for bit on the same kind of device; in Python if stages were replaced."""
    if campaign.info.get("stages"):
        found = f"rpojax.Campaign({str(campaign.directory)!r})"
        return f"rpojax.campaign.rerun.rerun({found}, {run}, pathlib.Path({out!r}), stages=...)"
    return f"rpojax rerun {shlex.quote(str(campaign.directory))} --run-id {run} --out {out}"


def resume_command(campaign: CampaignResults) -> str:
    """Command that completes a campaign and its report."""
    return f"rpojax resume {shlex.quote(str(campaign.directory))}"


def film_command(campaign: CampaignResults, run: int | None) -> str:
    """Command that makes a film of a run."""
    return f"rpojax film {shlex.quote(str(campaign.directory))} --run-id {run} --out film.mp4"
