"""Sensitivity of the key metrics to the dispersed inputs, by rank correlation and HSIC."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rpojax.analysis.statistics.dependence import InputRanking, rank_inputs
from rpojax.report.campaign_results import CampaignResults, rankable_scalars, runs_are_independent, select_key_metrics
from rpojax.report.figures.colours import BLUE, GRID, ORANGE
from rpojax.report.figures.plotly_charts import EMPTY_TITLE, Chart, chart_layout, rounded_values
from rpojax.report.labels import metric_label

_MAX_BARS = 8
_SIGNIFICANCE_LEVEL = 0.05
_LARGEST_COUNT = 3


def content(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: for each key metric its inputs, the strongest rank correlation first, and a sentence.

    P-values, corrected for the number of inputs, are None if runs are not independent; the leading inputs are then the
    largest ones, and `disagree` is None. Categorical inputs are left out.
    """
    inputs = {key: values for key, values in rankable_scalars(campaign).items() if np.isfinite(values).all()}
    rankings = {name: rank_inputs(inputs, campaign.metrics[name]) for name in select_key_metrics(campaign)}
    independent = runs_are_independent(campaign)
    return [_entry(name, ranking, independent) for name, ranking in rankings.items() if _is_ranked(ranking)]


def _is_ranked(ranking: InputRanking) -> bool:
    """Whether there are inputs, all with finite measures: extreme numbers may leave none."""
    return bool(ranking.inputs) and all(
        math.isfinite(entry.spearman) and math.isfinite(entry.hsic) for entry in ranking.inputs
    )


def chart(entry: Mapping[str, Any]) -> Chart:
    """Bars of both measures for the inputs that either ranks strongest; pale if not significant."""
    strongest = _strongest_inputs(entry["inputs"])
    names = [str(one["name"]) for one in strongest]
    measures = (("spearman", "spearman_p", BLUE, "x"), ("hsic", "hsic_p", ORANGE, "x2"))
    bars = [_bars(names, strongest, value, p_value, color, axis) for value, p_value, color, axis in measures]
    layout = chart_layout("Spearman rank correlation", "")
    layout |= {"showlegend": False, "bargap": 0.35, "margin": {"l": 20, "r": 14, "t": 6, "b": 44}}
    layout["xaxis"] |= {"domain": [0.0, 0.48], "range": [-1.0, 1.0], "zeroline": True, "zerolinecolor": GRID}
    layout["xaxis2"] = {
        **layout["xaxis"],
        "domain": [0.52, 1.0],
        "range": [0.0, max(0.05, 1.1 * max(float(entry["hsic"]) for entry in strongest))],
        "anchor": "y",
    }
    layout["xaxis2"]["title"] = {"text": "HSIC, normalised", "font": {"size": 12}}
    layout["yaxis"] |= {"automargin": True, "tickfont": {"size": 11}, "title": EMPTY_TITLE, "type": "category"}
    return {"data": bars, "layout": layout}


def _entry(name: str, ranking: InputRanking, independent: bool) -> dict[str, Any]:
    inputs = [
        {
            "name": entry.name,
            "spearman": entry.spearman,
            "spearman_p": entry.spearman_p if independent else None,
            "hsic": entry.hsic,
            "hsic_p": entry.hsic_p if independent else None,
        }
        for entry in ranking.inputs
    ]
    by_rank, by_hsic = list(ranking.leading_by_spearman), list(ranking.leading_by_hsic)
    if not independent:
        by_rank, by_hsic = _largest_inputs(inputs, "spearman"), _largest_inputs(inputs, "hsic")
    return {
        "metric": name,
        "title": metric_label(name).title,
        "runs": ranking.runs,
        "sampled": ranking.sampled,
        "inputs": inputs,
        "by_spearman": by_rank,
        "by_hsic": by_hsic,
        "disagree": ranking.disagree if independent else None,
        "sentence": _agreement_sentence(by_rank, by_hsic) if independent else _size_sentence(by_rank, by_hsic),
    }


def _largest_inputs(inputs: Sequence[Mapping[str, Any]], key: str) -> list[str]:
    """Names of the three largest inputs by one measure."""
    return [entry["name"] for entry in sorted(inputs, key=lambda entry: -abs(entry[key]))[:_LARGEST_COUNT]]


def _size_sentence(by_rank: Sequence[str], by_hsic: Sequence[str]) -> str:
    return (
        f"Greatest by rank correlation: {', '.join(by_rank)}; by HSIC: {', '.join(by_hsic)}. "
        "Whether chance would do as much is not told."
    )


def _agreement_sentence(by_rank: Sequence[str], by_hsic: Sequence[str]) -> str:
    if not by_rank and not by_hsic:
        return "No influence of an input can be told from chance by either method."
    if set(by_rank) == set(by_hsic):
        return f"Both methods name the same leading inputs: {', '.join(by_rank)}."
    only_hsic = [name for name in by_hsic if name not in by_rank]
    only_rank = [name for name in by_rank if name not in by_hsic]
    parts = ["The methods disagree."]
    if only_hsic:
        parts.append(
            f"Only HSIC puts {', '.join(only_hsic)} among the leading ones: look at the scatter for an influence that "
            "is no steady rise or fall."
        )
    if only_rank:
        parts.append(
            f"Only rank correlation puts {', '.join(only_rank)} among them: a steady trend that HSIC ranks behind "
            "others or cannot tell from chance."
        )
    return " ".join(parts)


def _strongest_inputs(inputs: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Strongest inputs by either measure, each relative to the largest of that measure, weakest first."""
    tops = {key: max(abs(entry[key]) for entry in inputs) or 1.0 for key in ("spearman", "hsic")}
    return sorted(inputs, key=lambda one: max(abs(one[key]) / top for key, top in tops.items()))[-_MAX_BARS:]


def _bars(
    names: list[str], shown: Sequence[Mapping[str, Any]], value: str, p_value: str, color: str, axis: str
) -> dict[str, Any]:
    significant = [one[p_value] is None or one[p_value] < _SIGNIFICANCE_LEVEL for one in shown]
    texts = ["p not given" if one[p_value] is None else f"p {one[p_value]:.2g}" for one in shown]
    return {
        "type": "bar",
        "orientation": "h",
        "x": rounded_values(np.array([one[value] for one in shown])),
        "y": names,
        "xaxis": axis,
        "yaxis": "y",
        "text": texts,
        "textposition": "none",
        "marker": {"color": color, "opacity": [0.85 if flag else 0.25 for flag in significant]},
        "hovertemplate": "%{y}: %{x:.3f}, %{text}<extra></extra>",
    }
