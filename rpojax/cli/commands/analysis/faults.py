"""The command `rpojax faults`: which faults of the equipment the runs of a scenario survive."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from rpojax.analysis.robustness import fault_study
from rpojax.campaign.storage.atomic_outputs import check_replaceable, write_json
from rpojax.cli.exit_status import Status
from rpojax.cli.options.analysis import FaultsCommand
from rpojax.cli.output_paths import claim_folder
from rpojax.cli.scenario_files import load, show_unused_keys
from rpojax.cli.standard_streams import print_json
from rpojax.errors import RpojaxError
from rpojax.report import survived_faults
from rpojax.report.page.faults_page import PAGE_NAME, write_page
from rpojax.scenario.plugins.command_lines import command_line

RECORD_NAME = "faults.json"


def faults(asked: FaultsCommand) -> int:
    """Does the work of the command; returns its exit status."""
    file = load(asked.scenario, asked.overrides)
    times = _times(asked.times)
    fault_study.check(file, asked.runs, asked.seed, times, asked.every, asked.double)
    show_unused_keys(file, quiet=asked.session.as_json, but="faults.")
    claim_folder(asked.out)
    check_replaceable((asked.out / name for name in (RECORD_NAME, PAGE_NAME)), asked.force)
    shown = not asked.session.as_json
    content = fault_study.faults(
        file,
        runs=asked.runs,
        seed=asked.seed,
        times_s=times,
        every_s=asked.every,
        double=asked.double,
        free_drifts=asked.free_drifts,
        progress=shown,
    )
    for cell in content["cells"]:
        cell["replay"] = _replay(asked, cell, file.plugin)
    write_json(asked.out / RECORD_NAME, content)
    write_page(content, asked.out)
    if shown:
        _show(content, asked.out)
    else:
        print_json({"directory": str(asked.out), **content})
    return Status.DONE


def _times(text: str) -> list[float] | None:
    """Times of a list with commas; None for an empty one.

    Raises:
        RpojaxError: a part is no number.
    """
    try:
        return [float(each) for each in text.split(",")] if text else None
    except ValueError:
        raise RpojaxError.of_argument("times", f"found {text[:60]!r}, expected numbers such as 500,1500") from None


def _replay(asked: FaultsCommand, cell: dict[str, Any], plugin: str | None) -> str:
    """Command that simulates the worst run of a cell alone, with its whole history."""
    settings = [word for each in (*asked.overrides, *cell["settings"]) for word in ("--set", each)]
    run = ["--seed", str(asked.seed), "--run-id", str(cell["worst_run"])]
    words = ("run", str(asked.scenario), *run, *settings, "--out", "worst_run")
    return command_line(*words, plugin=plugin)


def _show(content: dict[str, Any], out: Path) -> None:
    console = Console(highlight=False)
    table = Table()
    headings, *rows = survived_faults.table(content)
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="right" if place else "left", no_wrap=place == 0)
    for row in rows[: survived_faults.MOST_ROWS]:
        table.add_row(*row)
    console.print(table)
    for sentence in survived_faults.sentences(content):
        console.print(sentence, soft_wrap=True, markup=False)
    console.print(f"{out / PAGE_NAME}, {out / RECORD_NAME}", soft_wrap=True, markup=False)
