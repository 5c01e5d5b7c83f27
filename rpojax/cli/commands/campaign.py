"""The verbs that make campaigns and look at them."""

import json
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from rpojax.cli import console, dry_run_output
from rpojax.cli.arguments import (
    AsJson,
    Folder,
    Force,
    NoCache,
    NoFilm,
    Out,
    Overrides,
    Seed,
    Source,
    Status,
    fly,
    load,
    print_json,
)
from rpojax.errors import RpojaxError, UnfinishedError
from rpojax.runtime.jax_environment import prepare_jax, prepare_loop

if TYPE_CHECKING:
    from rpojax.campaign.execution.executors import Executor
    from rpojax.campaign.storage.campaign_folder import Campaign

ShardText = Annotated[
    str | None,
    arg(metavar="I/N", help="Only the blocks b with b % N == I - 1, into a folder shared with the other shards."),
]
WorkerCount = Annotated[
    int | None, arg(metavar="N", help="Processes that share the blocks; one that dies loses no other's work.")
]
ExecutorName = Annotated[str, arg(metavar="KIND", help="Who does the blocks: 'local', or 'dask' for a cluster.")]
Scheduler = Annotated[str | None, arg(metavar="ADDRESS", help="Of the running Dask scheduler.")]


def run(
    scenario: Source,
    *,
    out: Out,
    seed: Seed = 0,
    run_id: Annotated[int, arg(metavar="I", help="Number of the run in its campaign.")] = 0,
    overrides: Overrides = (),
    block_size: Annotated[
        int, arg(metavar="N", help="That of the campaign, for the very same numbers to the last digit.")
    ] = 1,
    force: Force = False,
    no_film: NoFilm = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """One run with its full history: a campaign of one run, with its report."""
    file = load(scenario, overrides)
    prepare_jax(cache=not no_cache)
    prepare_loop(rendered=file.camera.model == "rendered")
    from rpojax.campaign import run_and_resume

    def work(watch: console.Watch) -> "Campaign":
        return run_and_resume.run_campaign(
            file, 1, out, seed, first_run=run_id, block_size=block_size, force=force, on_progress=watch, report=True
        )

    with _keeping(out):
        return _conclude(fly(work, file.duration_s, as_json), report=True, as_json=as_json, film=not no_film)


def campaign(
    scenario: Source,
    *,
    runs: Annotated[int, arg(metavar="N", help="Number of runs.")],
    out: Annotated[
        Path | None, arg(metavar="DIR", help="Folder to make for the results.", help_behavior_hint="(required)")
    ] = None,
    seed: Seed = 0,
    overrides: Overrides = (),
    block_size: Annotated[
        int | None,
        arg(
            metavar="N", help="Runs at once on a device.", help_behavior_hint="(default: 128 on a CPU, 4096 elsewhere)"
        ),
    ] = None,
    histories: Annotated[
        str,
        arg(
            metavar="RULE",
            help="Histories to keep: none, all, N (the first N runs), I,J,... (run numbers), every:N, failures, "
            "worst:K:METRIC, or several joined by +.",
        ),
    ] = "8",
    history_channels: Annotated[
        str | None, arg(metavar="A,B,...", help="Channels to keep of a history.", help_behavior_hint="(default: all)")
    ] = None,
    history_every: Annotated[int, arg(metavar="N", help="Ticks from one kept sample of a history to the next.")] = 1,
    shard: ShardText = None,
    workers: WorkerCount = None,
    executor: ExecutorName = "local",
    scheduler: Scheduler = None,
    force: Force = False,
    no_report: Annotated[bool, arg(help="Write no report.html, report.json and figures.")] = False,
    no_film: NoFilm = False,
    dry_run: Annotated[bool, arg(help="Fly nothing: show what the runs would draw, and what they would take.")] = False,
    plan: Annotated[Path | None, arg(metavar="FILE", help="Of a dry run: CSV file to write, one row a run.")] = None,
    speed: Annotated[
        float | None, arg(metavar="X", help="Of a dry run: run-seconds per second, as `rpojax bench` tells.")
    ] = None,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Many dispersed runs, with a report on them."""
    dry_run_output.check(dry_run, plan, speed, out, force)
    file = load(scenario, overrides)
    _check_executor(executor, scheduler, workers, shard, force)
    prepare_jax(cache=not no_cache)
    prepare_loop(rendered=file.camera.model == "rendered")
    from rpojax.campaign import run_and_resume
    from rpojax.campaign.history_retention import Retention

    part = run_and_resume.Shard.parse(shard) if shard is not None else None
    channels = None if history_channels is None else tuple(filter(None, history_channels.split(",")))
    kept = Retention(histories, channels, history_every)
    if dry_run:
        dry_run_output.show(file, runs, seed, block_size, kept, out, force, plan, speed, as_json)
        return Status.DONE
    assert out is not None
    folder = out

    def work(watch: console.Watch) -> "Campaign":
        return run_and_resume.run_campaign(
            *(file, runs, folder, seed),
            block_size=block_size,
            histories=kept,
            force=force,
            on_progress=watch,
            shard=part,
            executor=_executor(executor, scheduler, workers),
            report=not no_report,
        )

    with _keeping(out):
        flown = fly(work, file.duration_s, as_json)
        return _conclude(flown, report=not no_report, as_json=as_json, film=not no_film, shared=part is not None)


def resume(
    directory: Folder,
    *,
    shard: ShardText = None,
    workers: WorkerCount = None,
    executor: ExecutorName = "local",
    scheduler: Scheduler = None,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Complete an interrupted campaign and its report; one that is complete is left as it is, with exit status 0."""
    _check_executor(executor, scheduler, workers, shard, force=False)
    prepare_jax(cache=not no_cache)
    from rpojax.campaign import run_and_resume
    from rpojax.campaign.storage import atomic_files
    from rpojax.campaign.storage.campaign_folder import Campaign

    part = run_and_resume.Shard.parse(shard) if shard is not None else None
    found = Campaign(directory)
    prepare_loop(rendered=found.file.camera.model == "rendered")
    if run_and_resume.is_complete(found):
        atomic_files.sweep(found.directory)
        if found.asked["report"] and not _has_whole_report(found):
            return _conclude(found, report=True, as_json=as_json)
        _show(found, lambda: _report_of(found), as_json)
        return Status.DONE

    def work(watch: console.Watch) -> "Campaign":
        return run_and_resume.resume_campaign(
            directory, on_progress=watch, shard=part, executor=_executor(executor, scheduler, workers)
        )

    with _keeping(directory):
        return _conclude(
            fly(work, found.file.duration_s, as_json), report=True, as_json=as_json, shared=part is not None
        )


def rerun(
    directory: Folder,
    *,
    run_id: Annotated[int, arg(metavar="I", help="Number of the run.")],
    out: Out,
    force: Force = False,
    no_film: NoFilm = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Fly one run of a campaign again, with its full history, and compare it with what was recorded."""
    prepare_jax(cache=not no_cache)
    from rpojax.campaign import rerun as again
    from rpojax.campaign.storage.campaign_folder import Campaign

    found = Campaign(directory)
    prepare_loop(rendered=found.file.camera.model == "rendered")
    outcomes: list[again.Rerun] = []

    def work(watch: console.Watch) -> "Campaign":
        outcomes.append(again.rerun(found, run_id, out, force=force, on_progress=watch))
        return outcomes[0].result

    with _keeping(out):
        flown = fly(work, float(found.asked["scenario"]["duration_s"]), as_json)
    [outcome] = outcomes
    comparison = {"recorded": outcome.recorded, "different": sorted(outcome.different)}
    if not as_json:
        print(f"rpojax: {_verdict(outcome)}", file=sys.stderr)
    return _conclude(flown, report=True, as_json=as_json, film=not no_film, more={"rerun": comparison})


def _verdict(outcome: Any) -> str:
    """How a run that was flown again compares with the campaign's."""
    if not outcome.recorded:
        return "the campaign has not recorded this run yet, so there is nothing to compare it with"
    if not outcome.different:
        return f"all {len(outcome.result.metrics)} metrics are those of the campaign, to the last bit"
    name, (before, now) = next(iter(sorted(outcome.different.items())))
    example = f"{name}: {before!r} there, {now!r} here"
    return f"{len(outcome.different)} metrics are not those of the campaign, such as {example}"


def status(directory: Folder, *, as_json: AsJson = False) -> int:
    """Where a campaign is: blocks, runs, failures and speed so far; also while others work on it."""
    from rpojax.campaign.status import status as look

    found = look(directory)
    if as_json:
        print_json(found)
    else:
        console.show_status(found)
    return Status.DONE


def report(
    directory: Folder,
    *,
    run_id: Annotated[
        int | None, arg(metavar="I", help="Run to show in detail.", help_behavior_hint="(default: the median one)")
    ] = None,
    no_film: NoFilm = False,
    as_json: AsJson = False,
) -> int:
    """Write report.html, report.json and figures anew."""
    prepare_jax(cache=True)
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.report.sections.summary import choose_run

    found = Campaign(directory)
    choose_run(found, run_id)
    _show(found, lambda: _write_report(found, as_json, not no_film, run_id), as_json)
    return Status.DONE


def _check_executor(executor: str, scheduler: str | None, workers: int | None, shard: str | None, force: bool) -> None:
    """Refuses options that contradict each other, before anything is done."""
    if executor not in ("local", "dask"):
        raise RpojaxError(f"--executor: found {executor!r}, expected 'local' or 'dask'")
    if (executor == "dask") != (scheduler is not None):
        found = f"--executor {executor} and {'no' if scheduler is None else 'a'} --scheduler"
        raise RpojaxError(f"--scheduler: found {found}, expected it with --executor dask and only there")
    if workers is not None and (workers < 1 or executor == "dask"):
        raise RpojaxError(f"--workers: found {workers}, expected at least 1, and --executor local")
    if shard is not None and force:
        raise RpojaxError("--force: found it with --shard, expected it without: a shard joins the folder of the others")


def _executor(name: str, scheduler: str | None, workers: int | None) -> "Callable[[Campaign], Executor] | None":
    """What does the blocks of a campaign; None for this process."""
    if name == "dask":
        from rpojax.campaign.execution.dask_executor import Cluster

        return lambda result: Cluster(result, scheduler or "")
    if workers is not None:
        from rpojax.campaign.execution.executors import Workers

        return lambda result: Workers(result, workers)
    return None


@contextmanager
def _keeping(directory: Path) -> Iterator[None]:
    """On an interrupt or a full disk, says what is kept and how to go on."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_kept(directory)) from None
    except UnfinishedError as error:
        raise UnfinishedError(f"{error}; {_kept(directory)}") from None


def _kept(directory: Path) -> str:
    from rpojax.campaign.storage.campaign_folder import Campaign

    try:
        found = Campaign(directory)
    except RpojaxError:
        return "nothing was written"
    missing, folder = len(found.missing()), shlex.quote(str(directory))
    if missing == 0:
        return (
            f"all runs are kept; go on with: rpojax resume {folder}, or write the report with: rpojax report {folder}"
        )
    return f"{found.blocks - missing} of {found.blocks} blocks are kept; go on with: rpojax resume {folder}"


def _conclude(
    result: "Campaign",
    report: bool,
    as_json: bool,
    film: bool = True,
    shared: bool = False,
    more: dict[str, Any] | None = None,
) -> int:
    """Shows the results, writes the report if it is wanted and returns the exit status.

    Where others work on the campaign too, only who finds nothing missing writes the report.
    """
    wanted = report and not (shared and result.missing())
    _show(result, lambda: _write_report(result, as_json, film) if wanted else None, as_json, more)
    if result.given_up:
        block, reason = next(iter(sorted(result.given_up.items())))
        raise UnfinishedError(f"found {len(result.given_up)} blocks given up, expected none; block {block}: {reason}")
    if not shared and (missing := result.missing()):
        raise UnfinishedError(f"found {len(missing)} blocks missing, expected none")
    return Status.DONE if result.completed.all() else Status.SOME_FAILED


def _has_whole_report(result: "Campaign") -> bool:
    """Whether there is a report, and on all runs: it may have been written before the last ones, or not to its end."""
    try:
        content = json.loads((result.directory / "report.json").read_text(encoding="utf-8"))
        return content["runs"]["missing"] == 0 and _report_of(result) is not None
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _report_of(result: "Campaign") -> Path | None:
    path = result.directory / "report.html"
    return path if path.is_file() else None


def _write_report(result: "Campaign", as_json: bool, film: bool, run_id: int | None = None) -> Path:
    from rpojax.report.page.html_report import write_report

    with console.busy("writing the report", quiet=as_json):
        return write_report(result, run_id, film=film)


def _show(
    result: "Campaign", report: Callable[[], Path | None], as_json: bool, more: dict[str, Any] | None = None
) -> None:
    """Shows the results; people see them before the report is written."""
    from rpojax.report.sections.summary import summarise

    summary = summarise(result)
    if as_json:
        path = report()
        place = {"directory": str(result.directory), "report": None if path is None else str(path)}
        print_json({**place, **summary, **(more or {})})
        return
    console.show_campaign(summary)
    console.show_places(result.directory, report())
