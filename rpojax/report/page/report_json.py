"""All that report.json holds and the page shows."""

from typing import Any

from rpojax.report.campaign_results import CampaignResults
from rpojax.report.json_values import to_json_types
from rpojax.report.page.campaign_summary import summarise
from rpojax.report.sections import (
    caveats_section,
    consistency_section,
    convergence_section,
    detection_section,
    dispersion_section,
    failure_section,
    safety_section,
    sensitivity_section,
    worst_runs_section,
)
from rpojax.report.sections.dispersion_section import DrawnDistribution


def report_content(campaign: CampaignResults, drawn: list[DrawnDistribution] | None = None) -> dict[str, Any]:
    """Content of report.json: what `summarise` gives, and a part from every module that judges the runs.

    `drawn` are the dispersions as drawn, where they are known already.
    """
    summary = summarise(campaign)
    lines = detection_section.detections_by_range(campaign.history(run) for run in sorted(campaign.history_ids))
    parts = {
        "safety": safety_section.content(campaign),
        "consistency": consistency_section.content(campaign),
        "convergence": convergence_section.content(campaign),
        "dispersions": [
            one.content() for one in (dispersion_section.drawn_distributions(campaign) if drawn is None else drawn)
        ],
        "sensitivity": sensitivity_section.content(campaign),
        "failure_causes": failure_section.content(campaign),
        "worst_runs": worst_runs_section.content(campaign),
        "detections": lines,
        "limits": caveats_section.caveat_sentences(campaign, summary),
    }
    return {**summary, **to_json_types(parts)}
