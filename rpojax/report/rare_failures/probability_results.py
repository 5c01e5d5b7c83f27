"""Estimates of probabilities in a campaign's folder, and its requirements that need one."""

import json
from collections.abc import Mapping
from typing import Any

from rpojax.analysis.reliability.simulated_failures.estimate_folder import RESULT_NAME, read_result
from rpojax.analysis.statistics import rare_requirements
from rpojax.campaign.storage import safe_paths
from rpojax.report import shell_commands
from rpojax.report.campaign_results import CampaignResults
from rpojax.scenario.plugins.plugin_registry import FROM_PYTHON

FOLDER_NAME = "probability"
"""Folder in that of the campaign in which estimates are found."""


def content(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: each estimate, and each requirement that plain runs cannot verify with its command.

    Raises:
        ResultError: a file of an estimate is not what was written, or lies elsewhere.
    """
    estimates = _estimates(campaign)
    found = [{"kind": "estimate", "same_scenario": same, "estimate": each} for each, same in estimates]
    known = {each["failure"]["metric"] for each, _ in estimates if each["requirement"] is not None}
    for entry in campaign.info.get("scenario", {}).get("requirements") or []:
        if rare_requirements.is_rare(entry["probability"]) and not (entry.keys() & {"phase", "from_s", "to_s"}):
            if entry["metric"] in known or entry.get("outcome") is not None:
                continue
            found.append(_wanted(campaign, entry))
    return found


def _wanted(campaign: CampaignResults, entry: Mapping[str, Any]) -> dict[str, Any]:
    """A requirement without an estimate: the runs that plain sampling needs, and the command if there is one."""
    metric, scenario = str(entry["metric"]), shell_commands.scenario_copy(campaign)
    out, plugin = scenario.parent / FOLDER_NAME / metric, shell_commands.plugin_of(campaign)
    possible = rare_requirements.can_be_estimated(metric, len(campaign.servicer_names)) and plugin != FROM_PYTHON
    return {
        "kind": "wanted",
        "metric": entry["metric"],
        "allowed": 1.0 - entry["probability"],
        "plain_runs": rare_requirements.plain_runs(entry["probability"], entry["consumer_risk"]),
        "command": rare_requirements.command(scenario, metric, out, plugin) if possible else "",
    }


def _estimates(campaign: CampaignResults) -> list[tuple[dict[str, Any], bool]]:
    """Finished estimates of the folder by name, and whether they are of the campaign's scenario."""
    root = campaign.directory / FOLDER_NAME
    safe_paths.check_no_links(campaign.directory, root)
    if not root.is_dir():
        return []
    found = []
    own = json.dumps(campaign.info.get("scenario_hash"))
    for directory in sorted(root.iterdir()):
        safe_paths.check_no_links(campaign.directory, directory)
        if directory.is_dir() and (directory / RESULT_NAME).is_file():
            estimate = read_result(directory)
            found.append((estimate, json.dumps(estimate.get("scenario_hash")) == own))
    return found
