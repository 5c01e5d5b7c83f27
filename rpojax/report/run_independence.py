"""How the runs of a campaign were chosen, and what may be said of them for that reason."""

from typing import Any

from rpojax.report.campaign_results import CampaignResults

_PHRASES = {
    "latin_hypercube": "a Latin hypercube",
    "sobol": "a Sobol sequence",
    "table": "a table of given values",
    "grid": "a grid of given values",
}


def design_kind(campaign: CampaignResults) -> str:
    """Kind of the scenario's design; one that states none draws every run independently."""
    return str((campaign.info.get("scenario", {}).get("design") or {}).get("kind", "independent"))


def runs_are_independent(campaign: CampaignResults) -> bool:
    """Whether runs are independent of one another, on which exact intervals and p-values rest."""
    return design_kind(campaign) == "independent"


def design_content(campaign: CampaignResults) -> dict[str, Any]:
    """Part of report.json."""
    return {"kind": design_kind(campaign), "independent": runs_are_independent(campaign)}


def design_phrase(campaign: CampaignResults) -> str:
    """The design as the object of a sentence."""
    found = design_kind(campaign)
    return _PHRASES.get(found, f"the design {found!r}")
