"""Requirements of a campaign changed afterwards: validated, and recorded in its folder so that the report shows it."""

from pathlib import Path

from rpojax.campaign.storage import campaign_seal
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError, RpojaxError, ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.untrusted.file_reading import FileKind
from rpojax.untrusted.text_reading import read_text
from rpojax.untrusted.toml_reading import parse_toml


def change_requirements(campaign: Campaign, file: Path, reason: str) -> Campaign:
    """Records the `[[requirements]]` of a TOML file as those on which a campaign is judged from now on.

    Args:
        campaign: with a seal, to which the record is bound
        file: all requirements that hold from now on, as in a scenario
        reason: why they change, shown in the report

    Raises:
        ScenarioError: the file holds no valid requirements, or something else, or the campaign lacks a metric.
        ResultError: the campaign is unsealed, so that nothing could show what was changed.
        RpojaxError: the file cannot be read, or there is no reason.
    """
    if not reason.strip():
        raise RpojaxError.of_argument("reason", "missing, expected why the requirements change")
    seal = campaign.configuration.seal
    if seal is None:
        raise ResultError(f"{campaign.directory}: found no seal, expected one to which a change can be bound")
    tables = parse_toml(read_text(file, FileKind.SCENARIO))
    if others := sorted(set(tables) - {"requirements"}):
        raise ScenarioError(others[0], "it beside requirements", "a file of [[requirements]] alone")
    changed = scenario_loader.validate_recorded(
        {**campaign.configuration.scenario, "requirements": tables.get("requirements")}
    )
    for index, requirement in enumerate(changed.requirements):
        if requirement.metric_name not in campaign.metrics:
            expected = "a metric that the campaign recorded"
            raise ScenarioError(f"requirements.{index}.metric", requirement.metric_name, expected)
    listed = [each.model_dump(mode="json") for each in changed.requirements]
    campaign_seal.record_change(campaign.directory, seal, campaign.requirement_changes, listed, reason)
    return Campaign(campaign.directory)
