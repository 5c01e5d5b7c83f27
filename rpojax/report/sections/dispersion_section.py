"""Dispersed values that the runs used, compared with the distributions that the scenario declares."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.analysis.statistics.dependence import holm_correction
from rpojax.analysis.statistics.dispersion_marginals import (
    Marginal,
    declared_nominal,
    drawn_marginals,
    goodness_of_fit_p,
)
from rpojax.report.campaign_results import CampaignResults, runs_are_independent
from rpojax.report.figures.plotly_charts import histogram_bins, histogram_chart
from rpojax.report.figures.requirement_limits import Limit, limits_of_metrics
from rpojax.report.labels import format_number, metric_label, of_all_servicers

SIGNIFICANCE_LEVEL = 0.01
"""P-value below which drawn values contradict the declared distribution."""
_MIN_RUNS = 10


@dataclass(frozen=True)
class DrawnDistribution:
    """Values of one dispersed scalar over all runs, in the unit of its key, and its declared distribution.

    `nominal` and `declared` are texts, empty if the scenario states none; `p` is the goodness-of-fit p-value of the
    drawn values, corrected for the number of scalars; `bin_heights` are those of the histogram, `expected_heights`
    those of the declared distribution, both relative to the largest.
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
        """Whether the drawn values differ significantly from the declared distribution."""
        return self.p is not None and self.p < SIGNIFICANCE_LEVEL

    def content(self) -> dict[str, Any]:
        """Part of report.json."""
        names = ("key", "nominal", "declared", "mean", "std", "minimum", "maximum", "law_mean", "law_std", "p")
        return {name: getattr(self, name) for name in names}


def drawn_distributions(campaign: CampaignResults) -> list[DrawnDistribution]:
    """Every dispersed scalar in drawing order; an attitude dispersed by a small rotation is shown as rotation vector.

    P-values are None for constants, unknown distributions and runs that are not independent.
    """
    scenario, independent = campaign.info.get("scenario", {}), runs_are_independent(campaign)
    drawn = [
        Marginal(marginal.name, marginal.values[np.isfinite(marginal.values)], marginal.distribution)
        for marginal in drawn_marginals(scenario, campaign.drawn)
    ]
    drawn = [one for one in drawn if len(one.values)]
    tested = [one for one in drawn if independent and one.distribution is not None and len(one.values) >= _MIN_RUNS]
    p_values = holm_correction(
        np.array([goodness_of_fit_p(one.values, one.distribution) for one in tested if one.distribution is not None])
    )
    by_name = {marginal.name: float(p) for marginal, p in zip(tested, p_values, strict=True)}
    return [_drawn_distribution(scenario, one, by_name.get(one.name)) for one in drawn]


def _drawn_distribution(scenario: Mapping[str, Any], one: Marginal, p: float | None) -> DrawnDistribution:
    values, declared = one.values, one.distribution
    counts, edges = histogram_bins(values)
    expected = np.zeros(0) if declared is None else len(values) * np.diff(declared.cdf(edges))
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
        law_mean=None if declared is None else float(declared.mean()),
        law_std=None if declared is None else float(declared.std()),
        p=p,
        bin_heights=[round(float(count / top), 3) for count in counts],
        expected_heights=[round(float(count / top), 3) for count in expected],
    )


def _declared_text(scenario: Mapping[str, Any], key: str) -> str:
    """Declaration of a dispersed scalar in the scenario: of its key, or of the component itself."""
    names = {key, key.partition("[")[0]}
    for entry in scenario.get("dispersions", []):
        if names & {entry.get("key"), *entry.get("keys", [])}:
            rest = ", ".join(f"{name} {value}" for name, value in entry.items() if name not in ("key", "keys", "kind"))
            return f"{entry.get('kind', '')} {rest}".strip()
    design = scenario.get("design", {})
    return str(design["kind"]) if names & set(design.get("values", {})) else ""


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
    """Remarks, each with whether it is bad: runs beyond each limit, failed and other runs without a value."""
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
