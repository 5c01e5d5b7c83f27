"""What was dispersed, as drawn, and how the metrics follow it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.analysis.statistics.dependence_measures import rank_correlations
from rpojax.analysis.statistics.dispersion_marginals import Marginal, fit_p, marginals, nominal
from rpojax.analysis.statistics.multiple_testing import holm
from rpojax.report.campaign_protocol import Results
from rpojax.report.figures.plotly_charts import binned, compact
from rpojax.report.labels import metric, number, ordered
from rpojax.report.sections.design_caveat import independent
from rpojax.report.sections.key_metrics import varies
from rpojax.scenario import dispersion_keys

LEVEL = 0.01
"""Chance below which a drawn distribution is called doubtful."""
_NOMINAL = ("fault.kind", "fault.wheel")
"""Keys whose numbers are names in disguise: none is greater than another."""
_FEWEST_RUNS = 10
_MOST_POINTS = 1500


@dataclass(frozen=True)
class Dispersion:
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
    bars: list[float]
    curve: list[float]

    @property
    def doubtful(self) -> bool:
        """Whether the drawn values contradict the declared law beyond chance."""
        return self.p is not None and self.p < LEVEL

    def content(self) -> dict[str, Any]:
        """Part of report.json."""
        names = ("key", "nominal", "declared", "mean", "std", "minimum", "maximum", "law_mean", "law_std", "p")
        return {name: getattr(self, name) for name in names}


def scalars(campaign: Results) -> dict[str, np.ndarray]:
    """Every dispersed scalar (runs,): a vector gives one entry per component, named `key[0]`, `key[1]`, ..."""
    return dispersion_keys.columns(
        {key: np.asarray(values, dtype=np.float64) for key, values in campaign.drawn.items()}
    )


def measured(campaign: Results) -> dict[str, np.ndarray]:
    """Dispersed scalars (runs,) that can be ranked: all but those whose numbers are codes, as of kinds of fault."""
    return {key: values for key, values in scalars(campaign).items() if key not in _NOMINAL}


def as_drawn(campaign: Results) -> list[Dispersion]:
    """Every dispersed scalar in drawing order, drawn beside declared; a turned quaternion as its rotation vector.

    P-values are None for constants, unknown laws and runs that are not independent.
    """
    scenario, known = campaign.info.get("scenario", {}), independent(campaign)
    found = [
        Marginal(one.name, one.values[np.isfinite(one.values)], one.law) for one in marginals(scenario, campaign.drawn)
    ]
    found = [one for one in found if len(one.values)]
    tested = [one for one in found if known and one.law is not None and len(one.values) >= _FEWEST_RUNS]
    chances = holm(np.array([fit_p(one.values, one.law) for one in tested if one.law is not None]))
    by_name = {one.name: float(chance) for one, chance in zip(tested, chances, strict=True)}
    return [_describe(scenario, one, by_name.get(one.name)) for one in found]


def explorer(campaign: Results) -> dict[str, Any] | None:
    """Data for scatter plots of each metric against each dispersed scalar, None with too few runs or nothing dispersed.

    Holds the values of at most 1500 runs (the first ones, which are as random as any), the rank correlation of each
    pair over all runs unless the scalar is a code, and the size below which a correlation of independent quantities
    lies in 95 % of the cases, None where runs are not independent.
    """
    inputs = {key: values for key, values in scalars(campaign).items() if np.ptp(values) > 0.0}
    ranked, known = {key: inputs[key] for key in measured(campaign) if key in inputs}, independent(campaign)
    found = campaign.metrics
    metrics = {name: found[name] for name in ordered(found) if varies(found[name])}
    if not inputs or not metrics:
        return None
    return {
        "runs": campaign.run_ids[:_MOST_POINTS].tolist(),
        "metrics": {
            name: {
                "title": metric(name).title,
                "unit": metric(name).unit,
                "values": compact(values[:_MOST_POINTS]),
                "rank": _ranks(values, ranked),
                "chance": round(1.96 / float(np.sqrt(np.isfinite(values).sum() - 1)), 4) if known else None,
            }
            for name, values in metrics.items()
        },
        "inputs": {key: compact(values[:_MOST_POINTS]) for key, values in inputs.items()},
    }


def _ranks(values: np.ndarray, inputs: Mapping[str, np.ndarray]) -> dict[str, float]:
    defined = np.isfinite(values)
    columns = {key: drawn[defined] for key, drawn in inputs.items() if np.ptp(drawn[defined]) > 0.0}
    if not columns:
        return {}
    found = rank_correlations(np.stack(list(columns.values()), axis=1), values[defined])
    return dict(zip(columns, np.round(found, 4).tolist(), strict=True))


def _describe(scenario: Mapping[str, Any], one: Marginal, p: float | None) -> Dispersion:
    values, law = one.values, one.law
    counts, edges = binned(values)
    expected = np.zeros(0) if law is None else len(values) * np.diff(law.cdf(edges))
    top = max(counts.max(), expected.max(initial=0.0))
    start = nominal(scenario, one.name)
    return Dispersion(
        key=one.name,
        nominal=number(float(start)) if isinstance(start, int | float) else "",
        declared=_declared(scenario, one.name),
        mean=float(values.mean()),
        std=float(values.std(ddof=1)) if len(values) > 1 else None,
        minimum=float(values.min()),
        maximum=float(values.max()),
        law_mean=None if law is None else float(law.mean()),
        law_std=None if law is None else float(law.std()),
        p=p,
        bars=[round(float(count / top), 3) for count in counts],
        curve=[round(float(count / top), 3) for count in expected],
    )


def _declared(scenario: Mapping[str, Any], key: str) -> str:
    """What a scenario says of a dispersed number: of its key as a whole, or of the component itself."""
    names = {key, key.partition("[")[0]}
    for entry in scenario.get("dispersions", []):
        if names & {entry.get("key"), *entry.get("keys", [])}:
            rest = ", ".join(f"{name} {value}" for name, value in entry.items() if name not in ("key", "keys", "kind"))
            return f"{entry.get('kind', '')} {rest}".strip()
    design = scenario.get("design", {})
    return str(design["kind"]) if names & set(design.get("values", {})) else ""
