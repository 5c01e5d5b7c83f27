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
from rpojax.runtime.progress_bar import ProgressCallback

if TYPE_CHECKING:
    from rpojax.campaign.history_retention import Retention
    from rpojax.campaign.storage.campaign_folder import Campaign


RunCount = Annotated[int, arg(metavar="N", help="Number of runs.")]
CampaignFolder = Annotated[
    Path | None, arg(metavar="DIR", help="Folder to create for the results.", help_behavior_hint="(required)")
]
BlockSize = Annotated[
    int | None,
    arg(metavar="N", help="Runs at once on a device.", help_behavior_hint="(default: 128 on a CPU, 4096 elsewhere)"),
]
HistoryRule = Annotated[
    str,
    arg(
        metavar="RULE",
        help="Histories to keep: none, all, N (the first N runs), I,J,... (run numbers), every:N, failures, "
        "worst:K:METRIC, or several joined by +.",
    ),
]
HistoryChannels = Annotated[
    str | None, arg(metavar="A,B,...", help="Channels to keep of a history.", help_behavior_hint="(default: all)")
]
HistoryStride = Annotated[int, arg(metavar="N", help="Ticks from one kept sample of a history to the next.")]
NoReport = Annotated[bool, arg(help="Write no report.html, report.json and figures.")]
DryRun = Annotated[
    bool, arg(help="Simulate nothing: show what the runs would draw, and the resources they would take.")
]
PlanFile = Annotated[Path | None, arg(metavar="FILE", help="CSV file to write in a dry run, one row per run.")]
AssumedSpeed = Annotated[
    float | None,
    arg(metavar="X", help="Run-seconds per second for the estimate of a dry run, as measured by `rpojax bench`."),
]


def campaign(
    scenario: Source,
    *,
    runs: RunCount,
    out: CampaignFolder = None,
    seed: Seed = 0,
    overrides: Overrides = (),
    block_size: BlockSize = None,
    histories: HistoryRule = "8",
    history_channels: HistoryChannels = None,
    history_every: HistoryStride = 1,
    shard: ShardText = None,
    workers: WorkerCount = None,
    executor: ExecutorName = "local",
    scheduler: Scheduler = None,
    force: Force = False,
    no_report: NoReport = False,
    no_film: NoFilm = False,
    dry_run: DryRun = False,
    plan: PlanFile = None,
    speed: AssumedSpeed = None,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Monte Carlo campaign: many dispersed runs, with a report."""
    dry_run_output.check(dry_run, plan, speed, out, force)
    file = load(scenario, overrides)
    check_executor(executor, scheduler, workers, shard, force)
    prepare_jax(cache=not no_cache)
    set_loop_fusion_flag(rendered=file.camera.model == "rendered")
    from rpojax.campaign import run_and_resume
    from rpojax.campaign.job_shard import Shard

    part = Shard.parse(shard) if shard is not None else None
    kept = _retention(histories, history_channels, history_every)
    if dry_run:
        dry_run_output.show(file, runs, seed, block_size, kept, out, force, plan, speed, as_json)
        return Status.DONE
    assert out is not None
    arguments = (file, runs, out, seed)

    def work(watch: ProgressCallback) -> "Campaign":
        return run_and_resume.run_campaign(
            *arguments,
            block_size=block_size,
            histories=kept,
            force=force,
            on_progress=watch,
            shard=part,
            executor=make_executor(executor, scheduler, workers),
            report=not no_report,
        )

    with keeping_results(out):
        result = with_progress(work, file.duration_s, as_json)
        return conclude(result, report=not no_report, as_json=as_json, film=not no_film, shared=part is not None)


def _retention(rule: str, channels: str | None, every: int) -> "Retention":
    """Rule of which histories are stored, from the options of the command."""
    from rpojax.campaign.history_retention import Retention

    return Retention(rule, None if channels is None else tuple(filter(None, channels.split(","))), every)
