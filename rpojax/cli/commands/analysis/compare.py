"""The command `rpojax compare`: what changed between campaigns of the same runs."""

import sys

from rich.console import Console
from rich.text import Text

from rpojax.analysis.statistics import campaign_comparison
from rpojax.analysis.statistics.campaign_comparison import CampaignComparison
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import output_paths
from rpojax.cli.options.analysis import CompareCommand
from rpojax.cli.standard_streams import print_json
from rpojax.cli.terminal_tables import Row, print_table
from rpojax.report.labels import format_number, metric_label
from rpojax.report.page import comparison_page
from rpojax.report.page.comparison_page import few_pairs_text, interval_text, signed
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
    _show(found)


def _show(compared: CampaignComparison) -> None:
    found, changed, independent = compared.runs, compared.changed, compared.independent
    console = Console(highlight=False)
    for each in changed:
        console.print(f"{each.key}: {each.first!r} -> {each.second!r}", markup=False, soft_wrap=True)
    title = f"{found.pairs} pairs of runs, {found.unpaired} without a partner"
    rows: list[Row] = []
    for change in comparison_page.ranked_changes(compared):
        shown, (words, tone) = metric_label(change.metric), comparison_page.change_words(change)
        cells = (
            format_number(change.first, 3),
            format_number(change.second, 3),
            signed(change.difference.value),
            interval_text(change.difference),
            Text(words, style={"good": "green", "alert": "red"}.get(tone, "")),
        )
        rows.append((shown.title, shown.unit, *cells))
    headings = ("metric", "unit", "first", "second", "difference", "95 % interval", "change")
    print_table(console, headings, rows, title=title, words=("unit", "change"), optional=("difference",), boxed=False)
    if any(change.is_changed for change in found.metrics):
        told = "change: the 95 % interval excludes none; so it does by chance for 1 in 20 metrics without one"
        console.print(told, soft_wrap=True)
    if independent and (few := few_pairs_text(found)):
        console.print(few, soft_wrap=True)
    headings = ("event", "both", "first alone", "second alone", "neither", "p (McNemar)")
    rows = []
    for event in (found.failures, *found.outcomes, *found.requirements):
        counts = event.both, event.only_first, event.only_second, event.neither
        rows.append((event.event, *map(str, counts), format_number(event.p_value, 3)))
    print_table(console, headings, rows, title="pairs by outcome", optional=("neither", "both"))
    if not independent:
        console.print("the runs of these designs are not independent draws: no intervals and no p-values")
