"""The command `rpojax compare`: what changed between campaigns of the same runs."""

import sys
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from rpojax.analysis.statistics import campaign_comparison
from rpojax.analysis.statistics.campaign_comparison import CampaignComparison, KeyChange
from rpojax.analysis.statistics.paired_comparison import PairedComparison
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import output_paths
from rpojax.cli.options.analysis import CompareCommand
from rpojax.cli.standard_streams import print_json
from rpojax.report.labels import format_number, in_display_order, metric_label, of_all_servicers
from rpojax.report.page import comparison_page
from rpojax.report.page.comparison_page import interval_text, signed
from rpojax.runtime.progress import stage


def compare(asked: CompareCommand) -> int:
    """Does the work of the command; returns its exit status."""
    if asked.out is not None:
        output_paths.claim(asked.out, asked.force, (".html",))

    comparison_page.check_count(2 + len(asked.more))
    with stage("comparing runs", quiet=asked.as_json, announce=False):
        campaigns = [Campaign(folder) for folder in (asked.first, asked.second, *asked.more)]
        found = [campaign_comparison.compare(campaigns[0], other, progress=False) for other in campaigns[1:]]
        if asked.out is not None:
            comparison_page.write_comparison(campaigns, found, asked.out)
    if asked.as_json:
        single = found[0].to_dict()
        print_json(single if len(found) == 1 else {"comparisons": [each.to_dict() for each in found]})
        return 0
    for each in found:
        _show_comparison(each, named=len(found) > 1)
    if asked.out is not None:
        print(f"page: {asked.out}")
    return 0


def _show_comparison(found: CampaignComparison, named: bool) -> None:
    if named:
        print(f"{found.first} -> {found.second}")
    for warning in found.warnings:
        print(f"rpojax: warning: {warning}", file=sys.stderr)
    _show(found.runs, found.changed, found.independent)


def _show(found: PairedComparison, changed: Sequence[KeyChange], independent: bool) -> None:
    console = Console(highlight=False)
    for each in changed:
        console.print(f"{each.key}: {each.first!r} -> {each.second!r}", markup=False, soft_wrap=True)
    table = Table(title=f"{found.pairs} pairs of runs, {found.unpaired} without a partner")
    for heading in ("metric", "unit"):
        table.add_column(heading)
    for heading in ("median, first", "second", "difference", "95 % interval", "ratio"):
        table.add_column(heading, justify="right")
    by_name = {change.metric: change for change in found.metrics}
    for name in of_all_servicers(in_display_order(by_name)):
        change, shown = by_name[name], metric_label(name)
        cells = (
            format_number(change.first),
            format_number(change.second),
            signed(change.difference.value) + (" *" if change.is_changed else ""),
            interval_text(change.difference),
            format_number(change.ratio.value, 3),
        )
        table.add_row(shown.title, shown.unit, *cells)
    console.print(table)
    if any(change.is_changed for change in found.metrics):
        console.print("* the 95 % interval excludes no change, by chance for one in twenty metrics without a change")
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
