"""Content of report.json, which the page shows."""

from typing import Any

from rpojax.campaign.storage.json_types import to_json_types
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.coverage import coverage_section
from rpojax.report.mission import phase_section
from rpojax.report.page.campaign_summary import summarise
from rpojax.report.rare_failures import probability_results
from rpojax.report.sections import (
    caveats_section,
    consistency_section,
    convergence_section,
    detection_section,
    failure_section,
    safety_section,
    sensitivity_section,
    worst_runs_section,
)
from rpojax.report.sections.dispersion_section import DrawnDistribution
from rpojax.report.team import team_section


def report_content(campaign: CampaignResults, drawn: list[DrawnDistribution]) -> dict[str, Any]:
    """Content of report.json: the summary and one part from each section; `drawn` are the campaign's distributions."""
    summary = summarise(campaign)
    detections = detection_section.detections_by_range(
        campaign.history(run, servicer)
        for run in sorted(campaign.history_ids)
        for servicer in range(max(1, len(campaign.servicer_names)))
    )
    parts = {
        "team": team_section.content(campaign),
        "mission": phase_section.content(campaign),
        "rare_failures": probability_results.content(campaign),
        "safety": safety_section.content(campaign),
        "coverage": coverage_section.content(campaign),
        "consistency": consistency_section.content(campaign),
        "convergence": convergence_section.content(campaign),
        "dispersions": [distribution.content() for distribution in drawn],
        "sensitivity": sensitivity_section.content(campaign),
        "failure_causes": failure_section.content(campaign),
        "events": failure_section.event_entries(campaign),
        "worst_runs": worst_runs_section.content(campaign),
        "detections": detections,
        "limits": caveats_section.caveat_sentences(campaign, summary),
    }
    return {**summary, **to_json_types(parts)}
