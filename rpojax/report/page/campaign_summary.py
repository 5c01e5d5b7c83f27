"""The numbers of a campaign as one dictionary: what a command shows, and the first part of report.json."""

from typing import Any

import numpy as np

from rpojax.errors import ResultError
from rpojax.report import run_independence
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.json_values import to_json_types
from rpojax.report.labels import in_display_order
from rpojax.report.metric_statistics import summary_statistics
from rpojax.report.sections import fault_section, requirement_verdict_section

_SELECTION_METRIC = "formation_error_rms_m"


def summarise(campaign: CampaignResults) -> dict[str, Any]:
    """Content of report.json: runs, metrics in their units, requirements, provenance and failures, without NaN."""
    metrics, independent = campaign.metrics, run_independence.runs_are_independent(campaign)
    counted = _run_counts(campaign)
    return {
        "runs": counted,
        "metrics": {
            name: to_json_types(summary_statistics(name, metrics[name], independent))
            for name in in_display_order(metrics)
        },
        "requirements": to_json_types(requirement_verdict_section.content(campaign, counted["missing"])),
        "design": run_independence.design_content(campaign),
        "provenance": to_json_types({key: value for key, value in campaign.info.items() if key != "scenario"}),
        "failures": _failures(campaign),
        "faults": fault_section.content(campaign),
    }


def choose_run(campaign: CampaignResults, run_id: int | None = None) -> int | None:
    """Run to show in detail: `run_id`, else the median one in formation error among kept histories, None without any.

    Raises ResultError where no history of `run_id` is kept.
    """
    kept = sorted(campaign.history_ids)
    if run_id is not None:
        if run_id not in kept:
            listed = ", ".join(map(str, kept[:20])) or "none"
            raise ResultError(f"run {run_id}: found no history, expected one of: {listed}")
        return run_id
    values = campaign.metrics.get(_SELECTION_METRIC, np.full(len(campaign.completed), np.nan))
    errors = dict(zip(campaign.run_ids.tolist(), values.tolist(), strict=True))
    ranked = sorted((run for run in kept if np.isfinite(errors.get(run, np.nan))), key=lambda run: errors[run])
    if ranked:
        return ranked[(len(ranked) - 1) // 2]
    return kept[0] if kept else None


def _run_counts(campaign: CampaignResults) -> dict[str, int]:
    completed, known = int(np.sum(campaign.completed)), len(campaign.completed)
    requested = int(campaign.info.get("runs", known))
    return {
        "requested": requested,
        "completed": completed,
        "failed": known - completed,
        "missing": requested - known,
    }


def _failures(campaign: CampaignResults) -> list[dict[str, Any]]:
    return [
        {"run_id": int(run), "at_s": to_json_types(at_s), "reason": str(reason)}
        for run, at_s, reason in zip(campaign.run_ids, campaign.failed_at_s, campaign.failure_reason, strict=True)
        if reason
    ]
