"""Failed runs by reason, and inputs that distinguish failed from completed runs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rpojax.analysis.statistics.dependence.two_sample_tests import InputSeparation, separate_failing_runs
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.dispersed_inputs import rankable_scalars
from rpojax.report.number_format import format_number, format_p_value
from rpojax.report.run_independence import runs_are_independent

_MAX_INPUTS = 5
_MAX_FAILURES = 50


def content(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: for each reason the number of runs, times of failure, and inputs, the most different first.

    P-values, corrected for the number of inputs, are None if runs are not independent; categorical inputs are left out.
    """
    completed = np.asarray(campaign.completed, dtype=bool)
    reasons = Counter(str(reason) for reason in campaign.failure_reason if reason)
    inputs = rankable_scalars(campaign)
    return [
        _cause_entry(campaign, inputs, completed, reason, runs_are_independent(campaign))
        for reason, _ in reasons.most_common()
    ]


def cause_rows(entry: Mapping[str, Any]) -> list[list[str]]:
    """Rows of a reason's table: input, direction of the difference, KS distance and p, AUC and p."""
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
    """Sentence on the inputs that differ significantly between failed and completed runs."""
    significant = [one["input"] for one in entry["inputs"][:_MAX_INPUTS] if _is_significant(one)]
    if not entry["inputs"]:
        return "There is no dispersed input to compare."
    if entry["inputs"][0]["ks_p"] is None:
        return "The runs are not independent, so no p-values are given."
    if not significant:
        return "No input differs significantly between these and completed runs."
    return f"Inputs that differ significantly between these and completed runs: {', '.join(significant)}."


def _cause_entry(
    campaign: CampaignResults, inputs: Mapping[str, np.ndarray], completed: np.ndarray, reason: str, independent: bool
) -> dict[str, Any]:
    failed = np.asarray(campaign.failure_reason == reason)
    compared = failed | completed
    found = separate_failing_runs({name: values[compared] for name, values in inputs.items()}, failed[compared])
    times = campaign.failed_at_s[failed]
    return {
        "reason": reason,
        "runs": int(failed.sum()),
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


def failure_table(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Count of each reason, the first failed runs, and the number of further ones."""
    rows = summary["failures"]
    return {
        "reasons": Counter(row["reason"] for row in rows).most_common(),
        "rows": [{**row, "at_s": format_number(row["at_s"])} for row in rows[:_MAX_FAILURES]],
        "more": max(0, len(rows) - _MAX_FAILURES),
    }
