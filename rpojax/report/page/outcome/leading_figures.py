"""The three figures of the first screen: where the runs went, and the weakest requirement over time and over runs."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final

from rpojax.report.figures.requirement_limits import CHANNEL_OF_METRIC
from rpojax.report.labels import CHANNEL_LABELS, metric_label
from rpojax.report.page.outcome.outcome_sentence import weakest_requirement

_FIGURES: Final = 3


@dataclass(frozen=True)
class LeadingFigure:
    """A chart of the page by its name, with its title."""

    chart: str
    title: str


def leading_figures(content: Mapping[str, Any], charts: Collection[str]) -> list[LeadingFigure]:
    """At most three of the page's `charts`: mission or range, the channel of the weakest requirement, its histogram."""
    weakest = weakest_requirement(content["requirements"])
    name = "" if weakest is None else str(weakest.get("of", weakest["metric"]))
    channel = CHANNEL_OF_METRIC.get(name.partition("@")[0], "nav_relative_error_m")
    wanted = [
        *_phases(content),
        LeadingFigure("envelope-range_m", "Range to the target [m], all runs"),
        *([] if channel == "range_m" else [_envelope(channel)]),
        LeadingFigure(f"histogram-{name}", _histogram_title(name)),
        _envelope("formation_error_m"),
        _envelope("nav_relative_error_m"),
        _envelope("delta_v_m_s"),
    ]
    found: dict[str, LeadingFigure] = {}
    for figure in wanted:
        if figure.chart in charts:
            found.setdefault(figure.chart, figure)
    figures = list(found.values())
    spread = [figure for figure in figures if figure.chart.startswith("histogram-")]
    return [*[figure for figure in figures if figure not in spread][: _FIGURES - len(spread)], *spread]


def _phases(content: Mapping[str, Any]) -> list[LeadingFigure]:
    """Phases of the mission, where the runs were in more than one."""
    phases = (content.get("mission") or {}).get("phases", [])
    several = sum(phase["runs"] > 0 for phase in phases) > 1
    return [LeadingFigure("phase-shares", "Runs in each phase of the mission [%]")] if several else []


def _envelope(channel: str) -> LeadingFigure:
    label = next((one for one in CHANNEL_LABELS if one.name == channel), None)
    title = channel if label is None else f"{label.title}{f' [{label.unit}]' if label.unit else ''}, all runs"
    return LeadingFigure(f"envelope-{channel}", title)


def _histogram_title(name: str) -> str:
    label = metric_label(name)
    return f"{label.title}{f' [{label.unit}]' if label.unit else ''}, weakest requirement" if name else ""
