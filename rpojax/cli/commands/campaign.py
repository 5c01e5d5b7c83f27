"""The command `rpojax campaign`: many dispersed runs, with a report."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rpojax.cli import dry_run_output
from rpojax.cli.arguments import AsJson, Force, NoCache, NoFilm, Overrides, Seed, Source, load
from rpojax.cli.campaign_output import conclude, keeping_results
from rpojax.cli.executor_options import ExecutorName, Scheduler, ShardText, WorkerCount, check_executor, make_executor
from rpojax.cli.exit_status import Status
from rpojax.cli.interruptible_work import with_progress
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag
from rpojax.runtime.progress import ProgressCallback

if TYPE_CHECKING:
    from rpojax.campaign.storage.campaign_folder import Campaign


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
    check_executor(executor, scheduler, workers, shard, force)
    prepare_jax(cache=not no_cache)
    set_loop_fusion_flag(rendered=file.camera.model == "rendered")
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

    def work(watch: ProgressCallback) -> "Campaign":
        return run_and_resume.run_campaign(
            *(file, runs, folder, seed),
            block_size=block_size,
            histories=kept,
            force=force,
            on_progress=watch,
            shard=part,
            executor=make_executor(executor, scheduler, workers),
            report=not no_report,
        )

    with keeping_results(out):
        flown = with_progress(work, file.duration_s, as_json)
        return conclude(flown, report=not no_report, as_json=as_json, film=not no_film, shared=part is not None)
