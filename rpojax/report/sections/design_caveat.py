"""How the runs of a campaign were chosen, and what may be said of them for that reason."""

from typing import Any

from rpojax.report.campaign_protocol import Results

_WORDS = {
    "latin_hypercube": "a Latin hypercube",
    "sobol": "a Sobol sequence",
    "table": "a table of given values",
    "grid": "a grid of given values",
}


def kind(campaign: Results) -> str:
    """Kind of the scenario's design; one that states none draws every run independently."""
    return str((campaign.info.get("scenario", {}).get("design") or {}).get("kind", "independent"))


def independent(campaign: Results) -> bool:
    """Whether runs are independent of one another, on which exact intervals and p-values rest."""
    return kind(campaign) == "independent"


def content(campaign: Results) -> dict[str, Any]:
    """Part of report.json."""
    return {"kind": kind(campaign), "independent": independent(campaign)}


def in_words(campaign: Results) -> str:
    """The design as the object of a sentence."""
    found = kind(campaign)
    return _WORDS.get(found, f"the design {found!r}")
