"""Distributions of the metrics over runs as histograms."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.charts.histogram_chart import histogram_chart
from rpojax.report.figures.requirement_limits import Limit, limits_of_metrics
from rpojax.report.labels import metric_label, of_all_servicers
from rpojax.report.number_format import format_number


def histogram_entries(campaign: CampaignResults, summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Label, median, p99 (p1 where low is bad) and chart of every metric; no chart if it does not vary.

    A metric with a requirement has a chart whenever two runs have a value, and comes first; `remarks` state the runs
    over its limit and those without a value, apart from each other. Metrics of one servicer of a team are left out.
    """
    limits = limits_of_metrics(summary["requirements"])
    entries = []
    for name in of_all_servicers(summary["metrics"]):
        entry = summary["metrics"][name]
        values = campaign.metrics[name]
        defined = values[np.isfinite(values)]
        label, own_limits = metric_label(name), limits.get(name, [])
        tail = label.tail_statistics[1]
        drawn = len(defined) > 1 and (float(np.ptp(defined)) > 0.0 or len(own_limits) > 0)
        entries.append(
            {
                "name": name,
                "metric": label,
                "p50": format_number(entry["p50"]),
                "tail": f"{tail} {format_number(entry[tail])}",
                "defined": len(defined),
                "remarks": _remarks(campaign, values, own_limits),
                "chart": histogram_chart(label, defined, own_limits) if drawn else None,
            }
        )
    return sorted(entries, key=lambda entry: entry["name"] not in limits)


def _remarks(campaign: CampaignResults, values: np.ndarray, limits: Sequence[Limit]) -> list[tuple[str, bool]]:
    """Texts on the runs beyond each limit, on failed runs without a value and on others, and whether it is bad."""
    remarks = []
    for limit in limits:
        count = int(np.sum(limit.is_broken_by(values)))
        side = "over" if limit.at_most else "under"
        remarks.append((f"{count} {side} the {limit.text}", count > 0))
    missing, has_failed = ~np.isfinite(values), np.asarray(campaign.failed, dtype=bool)
    failed, other = int(np.sum(missing & has_failed)), int(np.sum(missing & ~has_failed))
    if failed:
        remarks.append((f"{failed} failed and have no value", True))
    if other and failed + other < len(values):
        remarks.append((f"{other} did not fail and had nothing to measure", False))
    return remarks
