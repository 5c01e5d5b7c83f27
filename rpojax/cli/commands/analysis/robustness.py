"""The command `rpojax robustness`: how far believed quantities may be off before a requirement breaks."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from rpojax.analysis.robustness import study
from rpojax.campaign.storage.atomic_outputs import check_replaceable, write_json
from rpojax.cli.exit_status import Status
from rpojax.cli.options.analysis import RobustnessCommand
from rpojax.cli.output_paths import claim_folder
from rpojax.cli.scenario_files import load, show_unused_keys
from rpojax.cli.standard_streams import print_json
from rpojax.report import robust_margins
from rpojax.report.page.robustness_page import PAGE_NAME, PICTURE_NAME, write_page

RECORD_NAME = "robustness.json"


def robustness(asked: RobustnessCommand) -> int:
    """Does the work of the command; returns its exit status."""
    file = load(asked.scenario, asked.overrides)
    show_unused_keys(file, quiet=asked.session.as_json)
    study.check(file, asked.runs, asked.seed)
    claim_folder(asked.out)
    check_replaceable((asked.out / name for name in (RECORD_NAME, PAGE_NAME, PICTURE_NAME)), asked.force)
    shown = not asked.session.as_json
    content = study.robustness(file, runs=asked.runs, seed=asked.seed, free_drifts=asked.free_drifts, progress=shown)
    write_json(asked.out / RECORD_NAME, content)
    write_page(content, asked.out)
    if shown:
        _show(content, asked.out)
    else:
        print_json({"directory": str(asked.out), **content})
    return Status.DONE


def _show(content: dict[str, Any], out: Path) -> None:
    console = Console(highlight=False)
    table = Table()
    for heading in ("quantity", "sigma", "margin below", "margin above"):
        table.add_column(heading, justify="right" if heading == "sigma" else "left", no_wrap=heading == "quantity")
    for row in robust_margins.rows(content):
        table.add_row(row.name, row.sigma, row.low.with_requirement, row.high.with_requirement)
    console.print(table)
    for sentence in robust_margins.sentences(content):
        console.print(sentence, soft_wrap=True, markup=False)
    console.print(f"{out / PAGE_NAME}, {out / RECORD_NAME}, {out / PICTURE_NAME}", soft_wrap=True, markup=False)
