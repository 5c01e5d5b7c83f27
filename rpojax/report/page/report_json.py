"""Content of report.json, which the page shows."""

from collections.abc import Callable
from typing import Any

from rpojax.campaign.storage.json_types import to_json_types
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.coverage import coverage_section
from rpojax.report.mission import phase_section
from rpojax.report.page.campaign_summary import summarise
from rpojax.report.rare_failures import probability_results
from rpojax.report.sections import (
    consistency_section,
    convergence_section,
    detection_section,
    failure_section,
    safety_section,
    sensitivity_section,
    worst_runs_section,
)
from rpojax.report.sections.caveats_section import caveat_sentences
from rpojax.report.sections.dispersion_section import DrawnDistribution
from rpojax.report.team import team_section
from rpojax.report.worked_out import Notes


def report_content(
    campaign: CampaignResults, drawn: list[DrawnDistribution], notes: Notes | None = None
) -> dict[str, Any]:
    """Content of report.json: the summary and one part from each section; `drawn` are the campaign's distributions.

    What cannot be worked out from extreme numbers is left out, with a sentence in `notes` and in `limits`.
    """
    noted = notes or Notes()
    summary = noted.part("The summary", summarise, campaign)
    sections: dict[str, tuple[str, Callable[[CampaignResults], Any]]] = {
        "team": ("The team", team_section.content),
        "mission": ("The mission", phase_section.content),
        "rare_failures": ("Rare failures", probability_results.content),
        "safety": ("Passive safety", safety_section.content),
        "coverage": ("Coverage", coverage_section.content),
        "consistency": ("Consistency of the filter", consistency_section.content),
        "convergence": ("Convergence", convergence_section.content),
        "sensitivity": ("Dependence on the dispersed inputs", sensitivity_section.content),
        "failure_causes": ("Causes of failure", failure_section.content),
        "events": ("Events", failure_section.event_entries),
        "worst_runs": ("Worst runs", worst_runs_section.content),
        "detections": ("Detections", _detections),
    }
    parts = {name: noted.part(title, work, campaign) for name, (title, work) in sections.items()}
    parts["dispersions"] = [distribution.content() for distribution in drawn]
    sentences = noted.part("Limits of use", lambda results: caveat_sentences(results, summary), campaign)
    parts["limits"] = [*noted.sentences, *sentences]
    return {**summary, **to_json_types(parts)}


def _detections(campaign: CampaignResults) -> list[dict[str, Any]]:
    return detection_section.detections_by_range(
        campaign.history(run, servicer)
        for run in sorted(campaign.history_ids)
        for servicer in range(max(1, len(campaign.servicer_names)))
    )
