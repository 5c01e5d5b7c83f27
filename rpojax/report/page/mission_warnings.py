"""Warnings about the mission of a campaign that were known before its runs."""

from rpojax.errors import ScenarioError
from rpojax.report.campaign_results import CampaignResults
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.team import team_warnings


def known_before(campaign: CampaignResults) -> list[str]:
    """Warnings about a campaign's scenario, none if this version does not accept it."""
    try:
        file = scenario_loader.validate_recorded(campaign.info.get("scenario", {}))
    except ScenarioError:
        return []
    return team_warnings.mission_warnings(file)
