"""The command `rpojax resume`: completes an interrupted campaign."""

from typing import TYPE_CHECKING

from rpojax.cli.arguments import AsJson, Folder, NoCache
from rpojax.cli.campaign_output import conclude, has_whole_report, keeping_results, report_of, show_results
from rpojax.cli.executor_options import ExecutorName, Scheduler, ShardText, WorkerCount, check_executor, make_executor
from rpojax.cli.exit_status import Status
from rpojax.cli.interruptible_work import with_progress
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag
from rpojax.runtime.progress_bar import ProgressCallback

if TYPE_CHECKING:
    from rpojax.campaign.storage.campaign_folder import Campaign


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
    check_executor(executor, scheduler, workers, shard, force=False)
    prepare_jax(cache=not no_cache)
    from rpojax.campaign import run_and_resume
    from rpojax.campaign.job_shard import Shard
    from rpojax.campaign.storage import stale_files
    from rpojax.campaign.storage.campaign_folder import Campaign

    part = Shard.parse(shard) if shard is not None else None
    found = Campaign(directory)
    set_loop_fusion_flag(rendered=found.file.camera.model == "rendered")
    if run_and_resume.is_complete(found):
        stale_files.remove_stale_files(found.directory)
        if found.configuration["report"] and not has_whole_report(found):
            return conclude(found, report=True, as_json=as_json)
        show_results(found, lambda: report_of(found), as_json)
        return Status.DONE

    def work(watch: ProgressCallback) -> "Campaign":
        return run_and_resume.resume_campaign(
            directory, on_progress=watch, shard=part, executor=make_executor(executor, scheduler, workers)
        )

    with keeping_results(directory):
        return conclude(
            with_progress(work, found.file.duration_s, as_json), report=True, as_json=as_json, shared=part is not None
        )
