"""Summary of a campaign as one dictionary: what the commands print, and the first part of report.json."""

from typing import Any

import numpy as np

from rpojax.campaign.storage.json_types import to_json_types
from rpojax.report import run_independence
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import in_display_order
from rpojax.report.metric_statistics import summary_statistics
from rpojax.report.page import mission_warnings
from rpojax.report.sections import fault_section, requirement_verdict_section
from rpojax.report.team import servicer_results
from rpojax.simulation.outcomes.outcome_kinds import count_outcomes


def summarise(campaign: CampaignResults) -> dict[str, Any]:
    """Counts of runs, metrics, verdicts, design, provenance, failures, faults and warnings; null in place of NaN."""
    metrics, independent = campaign.metrics, run_independence.runs_are_independent(campaign)
    run_counts = _run_counts(campaign)
    return {
        "runs": run_counts,
        "metrics": {
            name: to_json_types(summary_statistics(name, metrics[name], independent))
            for name in in_display_order(metrics)
        },
        "requirements": to_json_types(requirement_verdict_section.content(campaign, run_counts["missing"])),
        "design": run_independence.design_content(campaign),
        "provenance": to_json_types({key: value for key, value in campaign.info.items() if key != "scenario"}),
        "failures": _failures(campaign),
        "faults": fault_section.content(campaign),
        "warnings": mission_warnings.known_before(campaign),
    }


def _run_counts(campaign: CampaignResults) -> dict[str, Any]:
    completed, failed, known = int(np.sum(campaign.completed)), int(np.sum(campaign.failed)), len(campaign.completed)
    requested = int(campaign.info.get("runs", known))
    return {
        "requested": requested,
        "completed": completed,
        "failed": failed,
        "not_judged": known - completed - failed,
        "missing": requested - known,
        "outcomes": count_outcomes(campaign.outcomes),
    }


def _failures(campaign: CampaignResults) -> list[dict[str, Any]]:
    details = servicer_results.unfinished_details(campaign)
    return [
        {
            "run_id": int(run),
            "outcome": str(outcome),
            "at_s": to_json_types(at_s),
            "reason": str(reason),
            "detail": details.get(int(run), ""),
        }
        for run, outcome, at_s, reason in zip(
            campaign.run_ids, campaign.outcomes, campaign.failed_at_s, campaign.failure_reason, strict=True
        )
        if reason
    ]
