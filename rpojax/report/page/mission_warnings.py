"""Warnings about the scenario of a campaign that were known before its runs."""

from rpojax.errors import ScenarioError
from rpojax.report.campaign_results import CampaignResults
from rpojax.scenario.loading import scenario_loader, scenario_warnings


def known_before(campaign: CampaignResults) -> list[str]:
    """Warnings about a campaign's scenario, none if this version does not accept it."""
    try:
        file = scenario_loader.validate_recorded(campaign.info.get("scenario", {}))
    except ScenarioError:
        return []
    return scenario_warnings.scenario_warnings(file, campaign.info.get("stages") or ())
