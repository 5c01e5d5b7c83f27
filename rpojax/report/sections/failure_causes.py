"""Failures by reason, and what sets failing runs apart from completed ones."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rpojax.analysis.statistics.rank_sensitivity import Separation, separate
from rpojax.report.campaign_protocol import Results
from rpojax.report.labels import chance, number
from rpojax.report.sections.design_caveat import independent
from rpojax.report.sections.dispersion_section import measured

_MOST_INPUTS = 5


def content(campaign: Results) -> list[dict[str, Any]]:
    """Part of report.json: for each reason how many runs failed, when, and all inputs but codes, most apart first.

    P-values, corrected for the number of inputs, are None where runs are not independent.
    """
    completed = np.asarray(campaign.completed, dtype=bool)
    reasons = Counter(str(reason) for reason in campaign.failure_reason if reason)
    inputs = measured(campaign)
    return [_cause(campaign, inputs, completed, reason, independent(campaign)) for reason, _ in reasons.most_common()]


def rows(entry: Mapping[str, Any]) -> list[list[str]]:
    """Lines of a reason's table: input, which way failing runs differ, KS distance and p, AUC and p."""
    return [
        [
            one["input"],
            "greater" if one["auc"] > 0.5 else "smaller",
            number(one["ks"], 3),
            chance(one["ks_p"]),
            number(one["auc"], 3),
            chance(one["auc_p"]),
        ]
        for one in entry["inputs"][:_MOST_INPUTS]
    ]


def sentence(entry: Mapping[str, Any]) -> str:
    """What the inputs say of a reason for failure."""
    named = [one["input"] for one in entry["inputs"][:_MOST_INPUTS] if _beyondchance(one)]
    if not entry["inputs"]:
        return "Nothing dispersed can be compared."
    if entry["inputs"][0]["ks_p"] is None:
        return "Runs of this design are not independent, so no p-values are given."
    if not named:
        return "No input sets these runs apart from completed ones beyond chance."
    return f"What sets these runs apart from completed ones beyond chance: {', '.join(named)}."


def _cause(
    campaign: Results, inputs: Mapping[str, np.ndarray], completed: np.ndarray, reason: str, known: bool
) -> dict[str, Any]:
    failing = np.asarray(campaign.failure_reason == reason)
    compared = failing | completed
    found = separate({name: values[compared] for name, values in inputs.items()}, failing[compared])
    times = campaign.failed_at_s[failing]
    return {
        "reason": reason,
        "runs": int(failing.sum()),
        "first_at_s": float(np.min(times)),
        "median_at_s": float(np.median(times)),
        "last_at_s": float(np.max(times)),
        "inputs": _inputs(found, known),
    }


def _inputs(found: Sequence[Separation], known: bool) -> list[dict[str, Any]]:
    return [
        {
            "input": one.name,
            "ks": one.contrast.distance,
            "ks_p": one.contrast.distance_p if known else None,
            "auc": one.contrast.auc,
            "auc_p": one.contrast.auc_p if known else None,
        }
        for one in found
    ]


def _beyondchance(one: Mapping[str, Any]) -> bool:
    p_values = [one[key] for key in ("ks_p", "auc_p") if one[key] is not None]
    return bool(p_values) and min(p_values) < 0.05
