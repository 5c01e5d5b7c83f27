"""Data of the interactive scatter plot: any metric against any dispersed quantity."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rpojax.analysis.statistics.dependence import spearman_columns
from rpojax.report.campaign_results import (
    CampaignResults,
    dispersed_scalars,
    has_variation,
    rankable_scalars,
    runs_are_independent,
)
from rpojax.report.figures.axis_scale import axis_ends
from rpojax.report.figures.plotly_charts import rounded_values
from rpojax.report.figures.requirement_limits import limits_of_metrics
from rpojax.report.labels import in_display_order, metric_label, of_all_servicers


def scatter_explorer(
    campaign: CampaignResults, rows: np.ndarray, requirements: Sequence[Mapping[str, Any]] = ()
) -> dict[str, Any] | None:
    """Data for scatter plots of each metric against each dispersed scalar; None with too few runs or nothing dispersed.

    Contains the drawn values of the runs in `rows`, the ends of an axis of each metric that a few runs far away do not
    stretch, the rank correlation of each pair over all runs (not for categorical inputs), and `independence_limit`,
    below which the correlation of independent quantities lies in 95 % of the cases; None if runs are not independent;
    and `limits`, value and text of those of the `requirements` of report.json.
    """
    limits = limits_of_metrics(requirements)
    inputs = {key: values for key, values in dispersed_scalars(campaign).items() if np.ptp(values) > 0.0}
    ranked = {key: inputs[key] for key in rankable_scalars(campaign) if key in inputs}
    independent = runs_are_independent(campaign)
    metrics = {
        name: campaign.metrics[name]
        for name in of_all_servicers(in_display_order(campaign.metrics))
        if has_variation(campaign.metrics[name])
    }
    if not inputs or not metrics:
        return None
    return {
        "metrics": {
            name: {
                "title": metric_label(name).title,
                "unit": metric_label(name).unit,
                "ends": axis_ends(values, [limit.value for limit in limits.get(name, [])]),
                "limits": [{"value": limit.value, "text": limit.text} for limit in limits.get(name, [])],
                "rank": _rank_correlations(values, ranked),
                "independence_limit": _independence_limit(values) if independent else None,
            }
            for name, values in metrics.items()
        },
        "inputs": {key: rounded_values(values[rows]) for key, values in inputs.items()},
    }


def _independence_limit(values: np.ndarray) -> float:
    return round(1.96 / float(np.sqrt(np.isfinite(values).sum() - 1)), 4)


def _rank_correlations(values: np.ndarray, inputs: Mapping[str, np.ndarray]) -> dict[str, float]:
    defined = np.isfinite(values)
    columns = {key: drawn[defined] for key, drawn in inputs.items() if np.ptp(drawn[defined]) > 0.0}
    if not columns:
        return {}
    found = spearman_columns(np.stack(list(columns.values()), axis=1), values[defined])
    return dict(zip(columns, np.round(found, 4).tolist(), strict=True))
