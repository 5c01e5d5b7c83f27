"""The command `rpojax compare`: what changed between two campaigns of the same runs."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from rpojax.cli.arguments import AsJson
from rpojax.cli.console import print_json
from rpojax.runtime.jax_environment import prepare_jax

if TYPE_CHECKING:
    from rpojax.analysis.statistics.campaign_comparison import KeyChange
    from rpojax.analysis.statistics.paired_comparison import IntervalEstimate, PairedComparison


def compare(
    first: Annotated[Positional[Path], arg(metavar="DIR_A", help="Folder of a campaign.")],
    second: Annotated[Positional[Path], arg(metavar="DIR_B", help="Folder of another one with the same seed.")],
    *,
    as_json: AsJson = False,
) -> int:
    """What changed from one campaign to another, run by run: run n had the same dispersions in both.

    With --json also the metrics of each servicer of a team.
    """
    prepare_jax(cache=True)
    from rpojax.analysis.statistics import campaign_comparison
    from rpojax.campaign.storage.campaign_folder import Campaign

    found = campaign_comparison.compare(Campaign(first), Campaign(second), progress=False)
    if as_json:
        print_json(found.to_dict())
    else:
        _show(found.runs, found.changed, found.independent)
    return 0


def _show(found: "PairedComparison", changed: "Sequence[KeyChange]", independent: bool) -> None:
    from rich.console import Console
    from rich.table import Table

    from rpojax.report.labels import in_display_order, metric_label, of_all_servicers
    from rpojax.report.number_format import format_number

    console = Console(highlight=False)
    for each in changed:
        console.print(f"{each.key}: {each.first!r} -> {each.second!r}", markup=False, soft_wrap=True)
    table = Table(title=f"{found.pairs} pairs of runs, {found.unpaired} without a partner")
    for heading in ("metric", "unit"):
        table.add_column(heading)
    for heading in ("median, first", "second", "ratio", "90 % interval"):
        table.add_column(heading, justify="right")
    by_name = {change.metric: change for change in found.metrics}
    for name in of_all_servicers(in_display_order(by_name)):
        change, shown = by_name[name], metric_label(name)
        cells = (
            format_number(change.first),
            format_number(change.second),
            format_number(change.ratio.value, 3),
            _interval(change.ratio),
        )
        table.add_row(shown.title, shown.unit, *cells)
    console.print(table)
    events = Table(title="pairs by outcome")
    events.add_column("event")
    for heading in ("both", "first alone", "second alone", "neither", "p (McNemar)"):
        events.add_column(heading, justify="right")
    for event in (found.failures, *found.outcomes, *found.requirements):
        counts = event.both, event.only_first, event.only_second, event.neither
        events.add_row(event.event, *map(str, counts), format_number(event.p_value, 3))
    console.print(events)
    if not independent:
        console.print("the runs of these designs are not independent draws: no intervals and no p-values")


def _interval(estimate: "IntervalEstimate") -> str:
    from rpojax.report.number_format import format_number

    if estimate.interval_90 is None:
        return format_number(None)
    low, high = estimate.interval_90
    return f"{format_number(low, 3)} to {format_number(high, 3)}"
