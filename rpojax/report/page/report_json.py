"""Content of report.json, which the page shows."""

import json
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from rpojax.campaign.storage.atomic_outputs import to_json_types
from rpojax.errors import ScenarioError
from rpojax.report import campaign_results, rare_failures
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import in_display_order
from rpojax.report.left_out_parts import Notes
from rpojax.report.metric_statistics import summary_statistics
from rpojax.report.sections import (
    cause_section,
    consistency_section,
    convergence_section,
    coverage_section,
    detection_section,
    driver_section,
    error_budget_section,
    failure_section,
    metrics_section,
    phase_section,
    port_section,
    requirement_verdict_section,
    safety_section,
    sensitivity_section,
    team_section,
)
from rpojax.report.sections.caveats_section import caveat_sentences
from rpojax.report.sections.dispersion_section import DrawnDistribution
from rpojax.scenario.loading import scenario_loader, scenario_warnings
from rpojax.simulation.outcomes.outcome_kinds import count_outcomes


def known_before(campaign: CampaignResults) -> list[str]:
    """Warnings about a campaign's scenario, none if this version does not accept it."""
    stages = tuple(str(each) for each in campaign.info.get("stages") or ())
    return list(_warnings(json.dumps(campaign.info.get("scenario", {}), default=str), stages))


@lru_cache(maxsize=4)
def _warnings(scenario: str, stages: tuple[str, ...]) -> tuple[str, ...]:
    """Warnings about a scenario in JSON: a report asks for them after the table in the terminal has."""
    try:
        file = scenario_loader.validate_recorded(json.loads(scenario))
    except ScenarioError:
        return ()
    return tuple(scenario_warnings.scenario_warnings(file, stages))


def summarise(campaign: CampaignResults) -> dict[str, Any]:
    """Counts of runs, metrics, verdicts, design, provenance, failures, faults and warnings; null in place of NaN."""
    metrics, independent = campaign.metrics, campaign_results.runs_are_independent(campaign)
    run_counts, why = _run_counts(campaign), cause_section.content(campaign)
    return {
        "runs": run_counts,
        "metrics": {
            name: to_json_types(summary_statistics(name, metrics[name], independent))
            for name in in_display_order(metrics)
        },
        "requirements": to_json_types(requirement_verdict_section.content(campaign, run_counts["missing"])),
        "design": campaign_results.design_content(campaign),
        "provenance": to_json_types({key: value for key, value in campaign.info.items() if key != "scenario"}),
        "failures": _failures(campaign, why),
        "why_failed": cause_section.without_texts(why),
        "faults": failure_section.fault_content(campaign),
        "warnings": known_before(campaign),
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


def _failures(campaign: CampaignResults, why: Mapping[str, Any]) -> list[dict[str, Any]]:
    details = {**team_section.unfinished_details(campaign), **cause_section.abort_details(campaign)}
    causes = cause_section.texts_of_runs(why)
    return [
        {
            "run_id": int(run),
            "outcome": str(outcome),
            "at_s": to_json_types(at_s),
            "reason": str(reason),
            "detail": details.get(int(run), ""),
            **causes.get(int(run), cause_section.NO_CAUSE),
        }
        for run, outcome, at_s, reason in zip(
            campaign.run_ids, campaign.outcomes, campaign.failed_at_s, campaign.failure_reason, strict=True
        )
        if reason
    ]


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
        "port": ("The docking port", port_section.content),
        "rare_failures": ("Rare failures", rare_failures.content),
        "safety": ("Passive safety", safety_section.content),
        "coverage": ("Coverage", coverage_section.content),
        "consistency": ("Consistency of the filter", consistency_section.content),
        "error_budgets": ("Error budgets", error_budget_section.content),
        "convergence": ("Convergence", convergence_section.content),
        "sensitivity": ("Dependence on the dispersed inputs", sensitivity_section.content),
        "drivers": ("Drivers", driver_section.content),
        "failure_causes": ("Causes of failure", failure_section.content),
        "events": ("Events", failure_section.event_entries),
        "worst_runs": ("Worst runs", metrics_section.worst_runs),
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
