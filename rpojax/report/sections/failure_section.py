"""Failures by reason, and what sets failing runs apart from completed ones."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rpojax.analysis.statistics.rank_sensitivity import InputSeparation, separate_failing_runs
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import format_number, format_p_value
from rpojax.report.run_independence import runs_are_independent
from rpojax.report.sections.dispersion_section import rankable_scalars

_MAX_INPUTS = 5


def content(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: for each reason how many runs failed, when, and all inputs but codes, most apart first.

    P-values, corrected for the number of inputs, are None where runs are not independent.
    """
    completed = np.asarray(campaign.completed, dtype=bool)
    reasons = Counter(str(reason) for reason in campaign.failure_reason if reason)
    inputs = rankable_scalars(campaign)
    return [
        _cause_entry(campaign, inputs, completed, reason, runs_are_independent(campaign))
        for reason, _ in reasons.most_common()
    ]


def cause_rows(entry: Mapping[str, Any]) -> list[list[str]]:
    """Lines of a reason's table: input, which way failing runs differ, KS distance and p, AUC and p."""
    return [
        [
            one["input"],
            "greater" if one["auc"] > 0.5 else "smaller",
            format_number(one["ks"], 3),
            format_p_value(one["ks_p"]),
            format_number(one["auc"], 3),
            format_p_value(one["auc_p"]),
        ]
        for one in entry["inputs"][:_MAX_INPUTS]
    ]


def cause_sentence(entry: Mapping[str, Any]) -> str:
    """What the inputs say of a reason for failure."""
    named = [one["input"] for one in entry["inputs"][:_MAX_INPUTS] if _is_significant(one)]
    if not entry["inputs"]:
        return "Nothing dispersed can be compared."
    if entry["inputs"][0]["ks_p"] is None:
        return "Runs of this design are not independent, so no p-values are given."
    if not named:
        return "No input sets these runs apart from completed ones beyond chance."
    return f"What sets these runs apart from completed ones beyond chance: {', '.join(named)}."


def _cause_entry(
    campaign: CampaignResults, inputs: Mapping[str, np.ndarray], completed: np.ndarray, reason: str, independent: bool
) -> dict[str, Any]:
    failing = np.asarray(campaign.failure_reason == reason)
    compared = failing | completed
    found = separate_failing_runs({name: values[compared] for name, values in inputs.items()}, failing[compared])
    times = campaign.failed_at_s[failing]
    return {
        "reason": reason,
        "runs": int(failing.sum()),
        "first_at_s": float(np.min(times)),
        "median_at_s": float(np.median(times)),
        "last_at_s": float(np.max(times)),
        "inputs": _input_entries(found, independent),
    }


def _input_entries(found: Sequence[InputSeparation], independent: bool) -> list[dict[str, Any]]:
    return [
        {
            "input": one.name,
            "ks": one.difference.ks_distance,
            "ks_p": one.difference.ks_p if independent else None,
            "auc": one.difference.auc,
            "auc_p": one.difference.auc_p if independent else None,
        }
        for one in found
    ]


def _is_significant(one: Mapping[str, Any]) -> bool:
    p_values = [one[key] for key in ("ks_p", "auc_p") if one[key] is not None]
    return bool(p_values) and min(p_values) < 0.05
