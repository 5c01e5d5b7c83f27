"""The commands `rpojax run`, `campaign`, `resume` and `rerun`, which simulate runs."""

import sys
from dataclasses import replace

from rpojax.analysis.reliability.simulated_failures.estimate_folder import EstimateFolder
from rpojax.campaign import rerun as again
from rpojax.campaign import run_and_resume, sequential_looks
from rpojax.campaign.options.campaign_options import UNSTATED, CampaignOptions
from rpojax.campaign.rerun import RerunResult
from rpojax.campaign.storage import folder_creation
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import dry_run_output
from rpojax.cli.campaign_output import (
    conclude,
    executor_factory,
    has_whole_report,
    keeping_results,
    report_of,
    show_rare_requirements,
    show_results,
)
from rpojax.cli.commands.campaigns.probability import resume_estimate
from rpojax.cli.exit_status import Status
from rpojax.cli.options.campaigns import CampaignCommand, RerunCommand, ResumeCommand, RunCommand
from rpojax.cli.scenario_files import fuse_loops_of, load, show_warnings
from rpojax.runtime.progress import run_progress
from rpojax.scenario.schema import ScenarioFile


def run(asked: RunCommand) -> int:
    """Does the work of the command; returns its exit status."""
    file = load(asked.scenario, asked.overrides)
    show_warnings(file, quiet=asked.as_json)
    options = CampaignOptions(runs=1, seed=asked.seed, first_run=asked.run_id, block_size=asked.block_size, report=True)
    with keeping_results(asked.out):
        with run_progress(file.duration_s, quiet=asked.as_json) as watch:
            result = run_and_resume.start_campaign(file, options, asked.out, force=asked.force, on_progress=watch)
        return conclude(result, report=True, as_json=asked.as_json, film=not asked.no_film)


def campaign(asked: CampaignCommand) -> int:
    """Does the work of the command; returns its exit status."""
    asked.dry_run.check(asked.out, asked.output.force)
    file = load(asked.scenario, asked.overrides)
    asked = replace(asked, options=_with_runs(file, asked.options))
    asked.executor.check(asked.output.force)
    execution = run_and_resume.Execution(shard=asked.executor.parse_shard(), executor=executor_factory(asked.executor))
    if asked.dry_run.dry_run:
        if asked.options.until_decided:
            asked = replace(asked, options=run_and_resume.planned(file, asked.options, execution))
        dry_run_output.show(file, asked.options, asked.dry_run, asked.out, asked.output.force, asked.session.as_json)
        return Status.DONE
    assert asked.out is not None
    show_warnings(file, quiet=asked.session.as_json)
    show_rare_requirements(file, asked.out, quiet=asked.session.as_json)
    wanted = replace(asked.options, report=not asked.output.no_report)
    with keeping_results(asked.out):
        with run_progress(file.duration_s, quiet=asked.session.as_json) as watch:
            result = run_and_resume.start_campaign(
                file, wanted, asked.out, execution, force=asked.output.force, on_progress=watch
            )
        shared = execution.shard is not None
        return conclude(
            result, report=wanted.report, as_json=asked.session.as_json, film=not asked.output.no_film, shared=shared
        )


def _with_runs(file: ScenarioFile, options: CampaignOptions) -> CampaignOptions:
    """Options with a number of runs: that of the plan where a campaign ends when it is decided and states none."""
    is_open = options.until_decided and options.runs == UNSTATED
    return replace(options, runs=sequential_looks.most_runs(file)) if is_open else options


def resume(asked: ResumeCommand) -> int:
    """Does the work of the command; returns its exit status."""
    asked.executor.check()
    if EstimateFolder(asked.directory).is_begun:
        asked.executor.refuse_other_processes()
        return resume_estimate(asked.directory, asked.session)
    shard = asked.executor.parse_shard()
    found = Campaign(asked.directory)
    fuse_loops_of(found.configuration.scenario)
    for lost in run_and_resume.release_lost(found, shard):
        print(f"rpojax: {lost.path}: {lost.words}; its block is simulated again", file=sys.stderr)
    if run_and_resume.is_complete(found):
        folder_creation.remove_stale_files(found.directory)
        found.verify()
        if found.configuration.options.report and not has_whole_report(found):
            return conclude(found, report=True, as_json=asked.session.as_json)
        show_results(found, lambda: report_of(found), asked.session.as_json)
        return Status.DONE
    with keeping_results(asked.directory):
        with run_progress(found.file.duration_s, quiet=asked.session.as_json) as watch:
            result = run_and_resume.resume_campaign(
                asked.directory, on_progress=watch, shard=shard, executor=executor_factory(asked.executor)
            )
        return conclude(result, report=True, as_json=asked.session.as_json, shared=shard is not None)


def rerun(asked: RerunCommand) -> int:
    """Does the work of the command; returns its exit status."""
    found = Campaign(asked.directory)
    fuse_loops_of(found.configuration.scenario)
    duration_s = float(found.configuration.scenario["duration_s"])
    with keeping_results(asked.out), run_progress(duration_s, quiet=asked.as_json) as watch:
        outcome = again.rerun(found, asked.run_id, asked.out, force=asked.force, on_progress=watch)
    comparison = {"recorded": outcome.was_recorded, "different": sorted(outcome.differences)}
    if not asked.as_json:
        print(f"rpojax: {_verdict(outcome)}", file=sys.stderr)
    return conclude(
        outcome.campaign, report=True, as_json=asked.as_json, film=not asked.no_film, more={"rerun": comparison}
    )


def _verdict(outcome: RerunResult) -> str:
    """Agreement of the repeated run with the record, in one sentence."""
    if not outcome.was_recorded:
        return "the campaign has not recorded this run yet, so there is nothing to compare it with"
    if not outcome.differences:
        return f"all {len(outcome.campaign.metrics)} metrics are those of the campaign, to the last bit"
    name, (before, now) = next(iter(sorted(outcome.differences.items())))
    example = f"{name}: {before!r} there, {now!r} here"
    return f"{len(outcome.differences)} metrics are not those of the campaign, such as {example}"
