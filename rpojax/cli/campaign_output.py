"""Output of commands that simulate campaigns: tables, report, exit status, and the hint after an interrupt."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rpojax.analysis.statistics import rare_requirements
from rpojax.campaign.execution.dask_executor import DaskExecutor
from rpojax.campaign.execution.executor import Executor
from rpojax.campaign.execution.process_executor import ProcessExecutor
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import console
from rpojax.cli.exit_status import Status
from rpojax.cli.options.campaigns import ExecutorOptions
from rpojax.cli.standard_streams import print_json
from rpojax.errors import RpojaxError, UnfinishedError
from rpojax.metrics import metric_catalogue
from rpojax.report.left_out_parts import Notes
from rpojax.report.page import written_report
from rpojax.report.page.brief_page import write_brief
from rpojax.report.page.html_report import write_report
from rpojax.report.page.report_json import summarise
from rpojax.runtime.progress import stage
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.plugins.command_lines import command_line
from rpojax.scenario.schema import ScenarioFile


@contextmanager
def keeping_results(directory: Path) -> Iterator[None]:
    """Adds to an interrupt or a full disk which blocks are stored and the command that continues."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        raise type(interrupt)(_kept_blocks_sentence(directory)) from None
    except UnfinishedError as error:
        raise UnfinishedError(f"{error}; {_kept_blocks_sentence(directory)}") from None


def _kept_blocks_sentence(directory: Path) -> str:
    try:
        found = Campaign(directory)
    except RpojaxError:
        return "nothing was written"
    missing, plugin = len(found.missing_blocks()), found.configuration.scenario.get("plugin")
    resume, report = (command_line(verb, directory, plugin=plugin) for verb in ("resume", "report"))
    if missing == 0:
        return f"all runs are kept; go on with: {resume}, or write the report with: {report}"
    return f"{found.block_count - missing} of {found.block_count} blocks are kept; go on with: {resume}"


def conclude(
    result: Campaign,
    report: bool,
    as_json: bool,
    film: bool = True,
    shared: bool = False,
    more: dict[str, Any] | None = None,
) -> int:
    """Prints the results, writes the report if wanted, and returns the exit status.

    Where others work on the campaign too, only who finds nothing missing writes the report.
    """
    wanted = report and not (shared and result.missing_blocks())
    show_results(result, lambda: write_campaign_report(result, as_json, film) if wanted else None, as_json, more)
    if result.failed_blocks:
        block, reason = next(iter(sorted(result.failed_blocks.items())))
        raise UnfinishedError(
            f"found {len(result.failed_blocks)} blocks given up, expected none; block {block}: {reason}"
        )
    if not shared and (missing := result.missing_blocks()):
        raise UnfinishedError(f"found {len(missing)} blocks missing, expected none")
    return Status.SOME_FAILED if result.failed.any() else Status.DONE


def show_results(
    result: Campaign, report: Callable[[], Path | None], as_json: bool, more: dict[str, Any] | None = None
) -> None:
    """Prints the results as tables, or as JSON; tables come before the report is written."""
    with metric_catalogue.metrics_of_scenario(plugin_registry.recorded_metrics(result.info)):
        with stage("evaluating the results", quiet=as_json, announce=False):
            summary = Notes().part("The summary", summarise, result)
        if as_json:
            path = report()
            place = {"directory": str(result.directory), "report": None if path is None else str(path)}
            print_json({**place, **summary, **(more or {})})
            return
        console.show_campaign(summary)
        console.show_places(result.directory, report())


def write_campaign_report(result: Campaign, as_json: bool, film: bool, run_id: int | None = None) -> Path:
    """Writes the report of a campaign, with a message while it lasts, and returns its path."""
    with stage("writing the report", quiet=as_json):
        return write_report(result, run_id, film=film, progress=False)


def write_brief_report(result: Campaign, as_json: bool, run_id: int | None = None) -> Path:
    """Writes the brief report of a campaign, with a message while it lasts, and returns its path."""
    with stage("writing the brief report", quiet=as_json):
        return write_brief(result, run_id)


def has_whole_report(result: Campaign) -> bool:
    """Whether a complete report on all runs exists as it was written; one that was changed does not count."""
    return written_report.is_as_written(result.directory, result.configuration.seal)


def report_of(result: Campaign) -> Path | None:
    """Path of the report of a campaign, None if there is none."""
    path = result.directory / "report.html"
    return path if path.is_file() else None


def executor_factory(options: ExecutorOptions) -> Callable[[Campaign], Executor] | None:
    """Maker of the executor of a campaign's blocks, None for this process."""
    if options.executor == "dask":
        return lambda result: DaskExecutor(result, options.scheduler or "")
    if (workers := options.workers) is not None:
        return lambda result: ProcessExecutor(result, workers)
    return None


def show_rare_requirements(file: ScenarioFile, out: Path, quiet: bool) -> None:
    """Prints on stderr which requirements take more plain runs than is practical, and the command that serves them.

    It takes the copy of the scenario in the folder of the campaign, `out`, which has all that was set by `--set`.
    """
    for each in [] if quiet else file.requirements:
        if rare_requirements.is_rare(each.probability) and each.is_of_all_runs:
            runs = rare_requirements.plain_runs(each.probability, each.consumer_risk)
            line = (
                f"rpojax: {each.metric} {each.bound} {each.limit:g} with probability {each.probability:.9g} takes "
                f"{runs:,} plain runs without a violation"
            )
            if rare_requirements.can_be_estimated(each.metric, len(file.servicers)):
                place = out / "probability" / each.metric
                command = rare_requirements.command(out / "scenario.toml", each.metric, place, file.plugin)
                line += f"; instead, after the campaign: {command}"
            print(line, file=sys.stderr)
