"""Whether the runs of a campaign are independent draws, as its experiment design decides."""

from typing import Any

from rpojax.report.campaign_results import CampaignResults

_PHRASES = {
    "latin_hypercube": "a Latin hypercube",
    "sobol": "a Sobol sequence",
    "table": "a table of given values",
    "grid": "a grid of given values",
}


def design_kind(campaign: CampaignResults) -> str:
    """Kind of the scenario's design; without one, every run is drawn independently."""
    return str((campaign.info.get("scenario", {}).get("design") or {}).get("kind", "independent"))


def runs_are_independent(campaign: CampaignResults) -> bool:
    """Whether the runs are independent, which exact intervals, p-values and verdicts require."""
    return design_kind(campaign) == "independent"


def design_content(campaign: CampaignResults) -> dict[str, Any]:
    """Part of report.json: kind of the design, and whether its runs are independent."""
    return {"kind": design_kind(campaign), "independent": runs_are_independent(campaign)}


def design_phrase(campaign: CampaignResults) -> str:
    """The design as a noun phrase."""
    found = design_kind(campaign)
    return _PHRASES.get(found, f"the design {found!r}")
