"""What was dispersed, as drawn, and how the metrics follow it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.analysis.statistics.dependence_measures import spearman_columns
from rpojax.analysis.statistics.dispersion_marginals import (
    Marginal,
    declared_nominal,
    drawn_marginals,
    goodness_of_fit_p,
)
from rpojax.analysis.statistics.multiple_testing import holm_correction
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.plotly_charts import histogram_bins, rounded_values
from rpojax.report.key_metrics import has_variation
from rpojax.report.labels import format_number, in_display_order, metric_label
from rpojax.report.run_independence import runs_are_independent
from rpojax.scenario import dispersion_keys

SIGNIFICANCE_LEVEL = 0.01
"""Chance below which a drawn distribution is called doubtful."""
_CATEGORICAL_KEYS = ("fault.kind", "fault.wheel")
"""Keys whose numbers are names in disguise: none is greater than another."""
_MIN_RUNS = 10
_MAX_POINTS = 1500


@dataclass(frozen=True)
class DrawnDistribution:
    """One dispersed scalar over all runs, in the unit of its key, and what the scenario says of it.

    `nominal` and `declared` are texts, empty where the scenario is silent; `p` is that of the drawn values under the
    declared law, corrected for the number of scalars; `bars` are bin heights, `curve` those that the law expects, both
    over the greatest of them.
    """

    key: str
    nominal: str
    declared: str
    mean: float
    std: float | None
    minimum: float
    maximum: float
    law_mean: float | None
    law_std: float | None
    p: float | None
    bin_heights: list[float]
    expected_heights: list[float]

    @property
    def contradicts_declaration(self) -> bool:
        """Whether the drawn values contradict the declared law beyond chance."""
        return self.p is not None and self.p < SIGNIFICANCE_LEVEL

    def content(self) -> dict[str, Any]:
        """Part of report.json."""
        names = ("key", "nominal", "declared", "mean", "std", "minimum", "maximum", "law_mean", "law_std", "p")
        return {name: getattr(self, name) for name in names}


def dispersed_scalars(campaign: CampaignResults) -> dict[str, np.ndarray]:
    """Every dispersed scalar (runs,): a vector gives one entry per component, named `key[0]`, `key[1]`, ..."""
    return dispersion_keys.component_columns(
        {key: np.asarray(values, dtype=np.float64) for key, values in campaign.drawn.items()}
    )


def rankable_scalars(campaign: CampaignResults) -> dict[str, np.ndarray]:
    """Dispersed scalars (runs,) that can be ranked: all but those whose numbers are codes, as of kinds of fault."""
    return {key: values for key, values in dispersed_scalars(campaign).items() if key not in _CATEGORICAL_KEYS}


def drawn_distributions(campaign: CampaignResults) -> list[DrawnDistribution]:
    """Every dispersed scalar in drawing order, drawn beside declared; a turned quaternion as its rotation vector.

    P-values are None for constants, unknown laws and runs that are not independent.
    """
    scenario, independent = campaign.info.get("scenario", {}), runs_are_independent(campaign)
    found = [
        Marginal(one.name, one.values[np.isfinite(one.values)], one.distribution)
        for one in drawn_marginals(scenario, campaign.drawn)
    ]
    found = [one for one in found if len(one.values)]
    tested = [one for one in found if independent and one.distribution is not None and len(one.values) >= _MIN_RUNS]
    chances = holm_correction(
        np.array([goodness_of_fit_p(one.values, one.distribution) for one in tested if one.distribution is not None])
    )
    by_name = {one.name: float(chance) for one, chance in zip(tested, chances, strict=True)}
    return [_drawn_distribution(scenario, one, by_name.get(one.name)) for one in found]


def scatter_explorer(campaign: CampaignResults) -> dict[str, Any] | None:
    """Data for scatter plots of each metric against each dispersed scalar, None with too few runs or nothing dispersed.

    Holds the values of at most 1500 runs (the first ones, which are as random as any), the rank correlation of each
    pair over all runs unless the scalar is a code, and the size below which a correlation of independent quantities
    lies in 95 % of the cases, None where runs are not independent.
    """
    inputs = {key: values for key, values in dispersed_scalars(campaign).items() if np.ptp(values) > 0.0}
    ranked, known = (
        {key: inputs[key] for key in rankable_scalars(campaign) if key in inputs},
        runs_are_independent(campaign),
    )
    found = campaign.metrics
    metrics = {name: found[name] for name in in_display_order(found) if has_variation(found[name])}
    if not inputs or not metrics:
        return None
    return {
        "runs": campaign.run_ids[:_MAX_POINTS].tolist(),
        "metrics": {
            name: {
                "title": metric_label(name).title,
                "unit": metric_label(name).unit,
                "values": rounded_values(values[:_MAX_POINTS]),
                "rank": _rank_correlations(values, ranked),
                "chance": round(1.96 / float(np.sqrt(np.isfinite(values).sum() - 1)), 4) if known else None,
            }
            for name, values in metrics.items()
        },
        "inputs": {key: rounded_values(values[:_MAX_POINTS]) for key, values in inputs.items()},
    }


def _rank_correlations(values: np.ndarray, inputs: Mapping[str, np.ndarray]) -> dict[str, float]:
    defined = np.isfinite(values)
    columns = {key: drawn[defined] for key, drawn in inputs.items() if np.ptp(drawn[defined]) > 0.0}
    if not columns:
        return {}
    found = spearman_columns(np.stack(list(columns.values()), axis=1), values[defined])
    return dict(zip(columns, np.round(found, 4).tolist(), strict=True))


def _drawn_distribution(scenario: Mapping[str, Any], one: Marginal, p: float | None) -> DrawnDistribution:
    values, law = one.values, one.distribution
    counts, edges = histogram_bins(values)
    expected = np.zeros(0) if law is None else len(values) * np.diff(law.cdf(edges))
    top = max(counts.max(), expected.max(initial=0.0))
    start = declared_nominal(scenario, one.name)
    return DrawnDistribution(
        key=one.name,
        nominal=format_number(float(start)) if isinstance(start, int | float) else "",
        declared=_declared_text(scenario, one.name),
        mean=float(values.mean()),
        std=float(values.std(ddof=1)) if len(values) > 1 else None,
        minimum=float(values.min()),
        maximum=float(values.max()),
        law_mean=None if law is None else float(law.mean()),
        law_std=None if law is None else float(law.std()),
        p=p,
        bin_heights=[round(float(count / top), 3) for count in counts],
        expected_heights=[round(float(count / top), 3) for count in expected],
    )


def _declared_text(scenario: Mapping[str, Any], key: str) -> str:
    """What a scenario says of a dispersed number: of its key as a whole, or of the component itself."""
    names = {key, key.partition("[")[0]}
    for entry in scenario.get("dispersions", []):
        if names & {entry.get("key"), *entry.get("keys", [])}:
            rest = ", ".join(f"{name} {value}" for name, value in entry.items() if name not in ("key", "keys", "kind"))
            return f"{entry.get('kind', '')} {rest}".strip()
    design = scenario.get("design", {})
    return str(design["kind"]) if names & set(design.get("values", {})) else ""
