"""The command `rpojax compare`: what changed between two campaigns of the same runs."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from rpojax.cli.arguments import AsJson
from rpojax.cli.console import print_json
from rpojax.runtime.jax_environment import prepare_jax

if TYPE_CHECKING:
    from rpojax.analysis.statistics.paired_comparison import Comparison, IntervalEstimate
    from rpojax.campaign.storage.campaign_folder import Campaign


def compare(
    first: Annotated[Positional[Path], arg(metavar="DIR_A", help="Folder of a campaign.")],
    second: Annotated[Positional[Path], arg(metavar="DIR_B", help="Folder of another one with the same seed.")],
    *,
    as_json: AsJson = False,
) -> int:
    """What changed from one campaign to another, run by run: run n had the same dispersions in both."""
    prepare_jax(cache=True)
    from rpojax.analysis.statistics import paired_comparison
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.campaign.storage.json_types import to_json_types
    from rpojax.dispersions.designs import experiment_design

    one, other = Campaign(first), Campaign(second)
    _check_paired(one, other)
    requirements = _requirements(one, other)
    independent = experiment_design.has_independent_runs(one.file) and experiment_design.has_independent_runs(other.file)
    runs = [paired_comparison.RunMetrics(each.run_ids, each.completed, each.metrics) for each in (one, other)]
    found = paired_comparison.compare_paired_runs(runs[0], runs[1], requirements, independent)
    changed = changes(one.info["scenario"], other.info["scenario"])
    if as_json:
        content = {"first": str(first), "second": str(second), "changed": changed, "independent": independent}
        print_json({**content, **to_json_types(dataclasses.asdict(found))})
    else:
        _show(found, changed, independent)
    return 0


def _check_paired(one: "Campaign", other: "Campaign") -> None:
    """Refuses campaigns whose runs of the same number are not the same case."""
    import numpy as np

    from rpojax.errors import ResultError

    found, expected = other.info["seed"], one.info["seed"]
    if found != expected:
        raise ResultError(f"{other.directory}: found seed {found}, expected {expected}, that of {one.directory}")
    _, in_one, in_other = np.intersect1d(one.run_ids, other.run_ids, return_indices=True)
    drawn = one.drawn, other.drawn
    for key in drawn[0].keys() & drawn[1].keys():
        values = drawn[0][key][in_one], drawn[1][key][in_other]
        if values[0].shape != values[1].shape or not np.array_equal(*values, equal_nan=True):
            raise ResultError(
                f"{other.directory}: found other values drawn for {key!r}, expected those of {one.directory}, "
                "so that runs of one number can be compared"
            )


def _requirements(one: "Campaign", other: "Campaign") -> list[Any]:
    """Requirements of either campaign, each once."""
    listed = [*one.file.requirements, *other.file.requirements]
    return [each for index, each in enumerate(listed) if each not in listed[:index]]


def changes(first: Any, second: Any, path: str = "") -> list[dict[str, Any]]:
    """Keys of two scenarios whose values differ, with both values."""
    if isinstance(first, dict) and isinstance(second, dict):
        keys = [*first, *(key for key in second if key not in first)]
        return [
            each
            for key in keys
            for each in changes(first.get(key), second.get(key), f"{path}.{key}" if path else str(key))
        ]
    return [] if first == second else [{"key": path, "first": first, "second": second}]


def _show(found: "Comparison", changed: Sequence[dict[str, Any]], independent: bool) -> None:
    from rich.console import Console
    from rich.table import Table

    from rpojax.report.labels import format_number, in_display_order, metric_label

    console = Console(highlight=False)
    for each in changed:
        console.print(f"{each['key']}: {each['first']!r} -> {each['second']!r}", markup=False, soft_wrap=True)
    table = Table(title=f"{found.pairs} pairs of runs, {found.unpaired} without a partner")
    for heading in ("metric", "unit"):
        table.add_column(heading)
    for heading in ("median, first", "second", "ratio", "90 % interval"):
        table.add_column(heading, justify="right")
    by_name = {change.metric: change for change in found.metrics}
    for name in in_display_order(by_name):
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
    for each in (found.failures, *found.requirements):
        counts = each.both, each.only_first, each.only_second, each.neither
        events.add_row(each.event, *map(str, counts), format_number(each.p_value, 3))
    console.print(events)
    if not independent:
        console.print("the runs of these designs are not independent draws: no intervals and no p-values")


def _interval(estimate: "IntervalEstimate") -> str:
    from rpojax.report.labels import format_number

    if estimate.interval_90 is None:
        return format_number(None)
    low, high = estimate.interval_90
    return f"{format_number(low, 3)} to {format_number(high, 3)}"
