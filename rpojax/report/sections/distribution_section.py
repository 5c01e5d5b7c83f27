"""Distributions of the metrics over runs as histograms."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.charts.histogram_chart import histogram_chart
from rpojax.report.labels import metric_label, of_all_servicers
from rpojax.report.number_format import format_number


def histogram_entries(campaign: CampaignResults, summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Label, median, p99 (p1 where low is bad) and chart of every metric; no chart if it does not vary.

    Metrics of one servicer of a team are left out.
    """
    entries = []
    for name in of_all_servicers(summary["metrics"]):
        entry = summary["metrics"][name]
        values = campaign.metrics[name]
        defined = values[np.isfinite(values)]
        label = metric_label(name)
        tail = label.tail_statistics[1]
        varies = len(defined) > 1 and float(np.ptp(defined)) > 0.0
        entries.append(
            {
                "name": name,
                "metric": label,
                "p50": format_number(entry["p50"]),
                "tail": f"{tail} {format_number(entry[tail])}",
                "defined": len(defined),
                "chart": histogram_chart(label, defined) if varies else None,
            }
        )
    return entries
