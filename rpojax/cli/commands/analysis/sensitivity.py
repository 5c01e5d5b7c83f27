"""The command `rpojax sensitivity`: which dispersions make the spread of a metric, from derivatives."""

from collections.abc import Sequence

from rich.console import Console

from rpojax.analysis.gradients import derivative_sensitivity
from rpojax.analysis.gradients.derivative_sensitivity import SensitivityAnalysis
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli.exit_status import Status
from rpojax.cli.options.analysis import SensitivityCommand
from rpojax.cli.output_paths import claim
from rpojax.cli.scenario_files import load, show_unused_keys
from rpojax.cli.standard_streams import print_json
from rpojax.cli.terminal_tables import print_table
from rpojax.report.labels import format_number

_WIDE = 110
"""Columns of a terminal from which on the table has place for whole keys."""
_OPTIONAL = ("most of one run", "median run")
"""Columns that a narrow terminal does without."""


def sensitivity(asked: SensitivityCommand) -> int:
    """Does the work of the command; returns its exit status."""
    if asked.out is not None:
        claim(asked.out, asked.force, (".json",))
    file = load(asked.scenario, asked.overrides)
    show_unused_keys(file, quiet=asked.as_json)

    sampled = None if asked.campaign is None else Campaign(asked.campaign)
    found = derivative_sensitivity.sensitivity(
        file, asked.metric, runs=asked.runs, campaign=sampled, seed=asked.seed, progress=not asked.as_json
    )
    if asked.out is not None:
        found.write(asked.out, asked.force)
    if asked.as_json:
        print_json(found.to_dict())
    else:
        _show(found)
    return Status.DONE


def _show(found: SensitivityAnalysis) -> None:
    console = Console(highlight=False)
    for one, other, reason in zip(found.metrics, found.agreements, found.unranked, strict=True):
        without = f" ({one.undefined} more have no value)" if one.undefined else ""
        title = f"{one.metric}: {format_number(one.sigma)} {one.unit} by dispersions, {len(one.values)} runs{without}"
        headings = ("input", f"trend [{one.unit}]", "sigma", "median run", "most of one run", "by sampling")
        shown, rows = one.shares[:10], []
        names = shown_names([share.name for share in shown], console.width)
        for share in shown:
            strength = None if other is None else other.strengths.get(share.name)
            cells = (
                names[share.name],
                format_number(share.trend),
                format_number(share.sigma),
                format_number(share.nominal),
                f"{share.one_run:.0%}",
                format_number(strength, 2),
            )
            rows.append(cells)
        print_table(console, headings, rows, title=title, optional=_OPTIONAL)
        if other is not None:
            console.print(
                f"{other.runs} sampled runs: standard deviation {format_number(other.std)} {one.unit}, "
                f"{len(other.both)} of the {len(other.leading)} leading inputs agree, rank correlation of both orders "
                f"{format_number(other.rank_correlation, 2)}",
                soft_wrap=True,
            )
        if reason is not None:
            console.print(f"nothing by sampling: {reason}", soft_wrap=True)
        if one.exceeds_spread:
            console.print(
                f"warning: {one.metric} varies by {format_number(one.std)} {one.unit} (1 sigma) in these runs, not by "
                f"{format_number(one.sigma)} {one.unit}: its derivatives are those of ripples, and neither they nor "
                "their order tell which dispersions make its spread; a campaign does",
                soft_wrap=True,
            )
        if one.kink is not None:
            console.print(f"{one.metric} is {one.kink}", soft_wrap=True)
    if found.space.unmapped:
        console.print(f"held at the value drawn by each run: {', '.join(found.space.unmapped)}", soft_wrap=True)


def shown_names(names: Sequence[str], width: int) -> dict[str, str]:
    """Names of inputs in a table of a terminal: in a narrow one without sections, where they stay distinct."""
    whole = dict(zip(names, names, strict=True))
    found = {name: name.partition(".")[2] or name for name in names}
    return found if width < _WIDE and len(set(found.values())) == len(found) else whole
