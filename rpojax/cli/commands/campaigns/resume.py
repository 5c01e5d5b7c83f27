"""The command `rpojax resume`: completes an interrupted campaign, or estimate of a probability."""

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from rpojax.cli.arguments import FLAT, Session
from rpojax.cli.campaign_output import conclude, has_whole_report, keeping_results, report_of, show_results
from rpojax.cli.commands.campaigns.probability import resume_estimate
from rpojax.cli.executor_options import ExecutorOptions
from rpojax.cli.exit_status import Status
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag
from rpojax.runtime.progress import run_progress, stage


def resume(
    directory: Annotated[Positional[Path], arg(metavar="DIR", help="Folder of a campaign, or of an estimate.")],
    executor: Annotated[ExecutorOptions, FLAT],
    session: Annotated[Session, FLAT],
) -> int:
    """Complete an interrupted campaign and its report, or an estimate; one that is complete is left as it is."""
    executor.check()
    from rpojax.analysis.reliability.simulated_failures.estimate_folder import EstimateFolder

    if EstimateFolder(directory).is_begun:
        executor.refuse_other_processes()
        return resume_estimate(directory, session)
    with stage("starting", quiet=session.as_json, announce=False):
        prepare_jax(cache=not session.no_cache)
        from rpojax.campaign import run_and_resume
        from rpojax.campaign.storage import folder_creation
        from rpojax.campaign.storage.campaign_folder import Campaign

    shard = executor.parse_shard()
    found = Campaign(directory)
    set_loop_fusion_flag(rendered=found.file.camera.model == "rendered")
    if run_and_resume.is_complete(found):
        folder_creation.remove_stale_files(found.directory)
        found.verify()
        if found.configuration.options.report and not has_whole_report(found):
            return conclude(found, report=True, as_json=session.as_json)
        show_results(found, lambda: report_of(found), session.as_json)
        return Status.DONE

    with keeping_results(directory):
        with run_progress(found.file.duration_s, quiet=session.as_json) as watch:
            result = run_and_resume.resume_campaign(
                directory, on_progress=watch, shard=shard, executor=executor.executor_factory()
            )
        return conclude(result, report=True, as_json=session.as_json, shared=shard is not None)
