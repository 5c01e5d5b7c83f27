"""The runs that the report shows in detail: the median one, and the worst one of each requirement."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.metrics.metric_catalogue import worst_first
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import metric_label
from rpojax.report.number_format import format_number, with_unit


@dataclass(frozen=True)
class WorstRun:
    """Worst run of a metric with a history: what it is the worst in, its value, and that of the median run.

    `worst_id` is the worst run of all. Where that has no history, `remark` says so, and a better one stands for it.
    """

    run_id: int
    worst_id: int
    metric: str
    title: str
    value: str
    median_value: str
    remark: str = ""


def worst_runs(campaign: CampaignResults, content: Mapping[str, Any], median_run: int | None) -> list[WorstRun]:
    """Worst run of every requirement, the weakest first; without requirements of the metrics that the report ranks."""
    names = [str(entry.get("of", entry["metric"])) for entry in _weakest_first(content["requirements"])]
    names = names or [str(entry["metric"]) for entry in content["worst_runs"]]
    found = [_worst_run(campaign, name, median_run) for name in dict.fromkeys(names)]
    return [one for one in found if one is not None]


def _weakest_first(requirements: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Requirements by their share of violations, then by the worst value relative to the limit."""

    def badness(entry: Mapping[str, Any]) -> tuple[float, float]:
        if entry["worst"] is None:
            return -float(entry["violations"]), 0.0
        sign = 1.0 if entry["bound"] == "at most" else -1.0
        return -float(entry["violations"]), sign * (entry["limit"] - entry["worst"]) / (abs(entry["limit"]) or 1.0)

    return sorted(requirements, key=badness)


def _worst_run(campaign: CampaignResults, name: str, median_run: int | None) -> WorstRun | None:
    values = campaign.metrics.get(name)
    if values is None:
        return None
    ranked = [int(campaign.run_ids[row]) for row in worst_first(name, values)]
    kept = set(campaign.history_ids)
    shown = next((run for run in ranked if run in kept), None)
    if shown is None or len(ranked) < 2:
        return None
    remark = "" if shown == ranked[0] else f"run {ranked[0]} is worse; its history was not kept"
    label = metric_label(name)

    def text(run: int | None) -> str:
        rows = np.flatnonzero(campaign.run_ids == run)
        value = float(values[rows[0]]) if run is not None and len(rows) else None
        return with_unit(format_number(value), label.unit)

    return WorstRun(shown, ranked[0], name, label.title, text(shown), text(median_run), remark)
