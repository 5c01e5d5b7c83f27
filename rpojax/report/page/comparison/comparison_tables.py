"""Tables of the page on what changed: metrics, events, requirements, changed keys, and its sentence."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rpojax.analysis.statistics.campaign_comparison import CampaignComparison
from rpojax.analysis.statistics.paired_comparison import IntervalEstimate, MedianChange
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import in_display_order, metric_label, of_all_servicers
from rpojax.report.number_format import format_number, format_p_value
from rpojax.report.sections import requirement_verdict_section

_CHANCE = 0.05
"""Share of metrics without a change whose 95 % interval excludes it nevertheless."""


@dataclass(frozen=True)
class ChangeRow:
    """A metric: its title and unit, cells (medians, difference, its interval, ratio), and whether it changed."""

    name: str
    title: str
    unit: str
    cells: list[str]
    is_changed: bool
    direction: str


def change_rows(found: CampaignComparison) -> list[ChangeRow]:
    """Metrics in display order, those that changed first; of a team the metrics of all servicers together."""
    by_name = {change.metric: change for change in found.runs.metrics}
    rows = [_change_row(by_name[name]) for name in of_all_servicers(in_display_order(by_name))]
    return sorted(rows, key=lambda row: not row.is_changed)


def event_rows(found: CampaignComparison) -> list[list[str]]:
    """Event, pairs with it in both, in the first alone, in the second alone, in neither, and p-value."""
    runs = found.runs
    return [
        [
            event.event,
            *map(str, (event.both, event.only_first, event.only_second, event.neither)),
            format_p_value(event.p_value),
        ]
        for event in (runs.failures, *runs.outcomes, *runs.requirements)
    ]


def comparison_sentence(found: CampaignComparison) -> str:
    """How many metrics changed, how many would by chance, and what became of failures."""
    runs = found.runs
    judged = [one for one in runs.metrics if "/" not in one.metric and one.difference.interval_95 is not None]
    changed = sum(one.is_changed for one in judged)
    failed = runs.failures.both + runs.failures.only_first, runs.failures.both + runs.failures.only_second
    alone = f" ({runs.unpaired} without a partner)" if runs.unpaired else ""
    parts = [f"{runs.pairs} pairs of runs{alone}"]
    if found.independent:
        by_chance = _CHANCE * len(judged)
        parts.append(
            f"the median of {changed} of {len(judged)} metrics changed (about {by_chance:.0f} would seem to by chance)"
        )
    p_value = "" if runs.failures.p_value is None else f" (p {format_p_value(runs.failures.p_value)})"
    parts.append(f"failed runs {failed[0]} \N{RIGHTWARDS ARROW} {failed[1]}{p_value}")
    return "; ".join(parts) + "."


def requirement_table(campaigns: Sequence[CampaignResults]) -> list[tuple[str, list[tuple[str, str, str]]]]:
    """Requirement, and for each campaign verdict, CSS class and violations; a dash where it is not stated."""
    columns: list[dict[str, Any]] = []
    titles: list[str] = []
    for campaign in campaigns:
        missing = int(campaign.info.get("runs", len(campaign.completed))) - len(campaign.completed)
        rows = requirement_verdict_section.rows(requirement_verdict_section.content(campaign, missing))
        columns.append({f"{row.title}, {row.probability}": row for row in rows})
        titles += [title for title in columns[-1] if title not in titles]
    empty = ("\N{EN DASH}", "open", "not stated")
    return [
        (
            title,
            [
                (column[title].verdict, column[title].css_class, column[title].note.partition("; ")[2])
                if title in column
                else empty
                for column in columns
            ],
        )
        for title in titles
    ]


def _change_row(change: MedianChange) -> ChangeRow:
    label = metric_label(change.metric)
    difference = change.difference.value
    direction = "" if not change.is_changed or difference is None else "higher" if difference > 0.0 else "lower"
    cells = [
        format_number(change.first),
        format_number(change.second),
        signed(difference),
        interval_text(change.difference),
        format_number(change.ratio.value, 3),
        str(change.pairs),
    ]
    return ChangeRow(change.metric, label.title, label.unit, cells, change.is_changed, direction)


def signed(value: float | None, digits: int = 3) -> str:
    """Number with its sign."""
    if value is None:
        return format_number(None)
    return f"{'+' if value > 0.0 else chr(0x2212) if value < 0.0 else ''}{format_number(abs(value), digits)}"


def interval_text(estimate: IntervalEstimate) -> str:
    """The 95 % interval, a dash without one."""
    ends = estimate.interval_95
    return format_number(None) if ends is None else f"{signed(ends[0])} to {signed(ends[1])}"
