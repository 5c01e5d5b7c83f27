"""The command `rpojax campaign`: many dispersed runs, with a report."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.cli import dry_run_output
from rpojax.cli.arguments import FLAT, Force, NoFilm, Overrides, Session, Source, load
from rpojax.cli.campaign_output import conclude, keeping_results
from rpojax.cli.console import show_rare_requirements, show_warnings
from rpojax.cli.dry_run_output import DryRunOptions
from rpojax.cli.executor_options import ExecutorOptions
from rpojax.cli.exit_status import Status
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag
from rpojax.runtime.progress import run_progress, stage

CampaignFolder = Annotated[
    Path | None, arg(metavar="DIR", help="Folder to create for the results.", help_behavior_hint="(required)")
]


@dataclass(frozen=True)
class CampaignOutput:
    """What a campaign writes beside its results, and what it may replace."""

    force: Force = False
    no_report: Annotated[bool, arg(help="Write no report.html, report.json and figures.")] = False
    no_film: NoFilm = False


def campaign(
    scenario: Source,
    options: Annotated[CampaignOptions, FLAT],
    executor: Annotated[ExecutorOptions, FLAT],
    output: Annotated[CampaignOutput, FLAT],
    dry_run: Annotated[DryRunOptions, FLAT],
    session: Annotated[Session, FLAT],
    *,
    out: CampaignFolder = None,
    overrides: Overrides = (),
) -> int:
    """Monte Carlo campaign: many dispersed runs, with a report."""
    dry_run.check(out, output.force)
    file = load(scenario, overrides)
    executor.check(output.force)
    with stage("starting", quiet=session.as_json, announce=False):
        prepare_jax(cache=not session.no_cache)
        set_loop_fusion_flag(rendered=file.camera.model == "rendered")
        from rpojax.campaign import run_and_resume

    execution = run_and_resume.Execution(shard=executor.parse_shard(), executor=executor.executor_factory())
    if dry_run.dry_run:
        dry_run_output.show(file, options, dry_run, out, output.force, session.as_json)
        return Status.DONE
    assert out is not None
    show_warnings(file, quiet=session.as_json)
    show_rare_requirements(file, out, quiet=session.as_json)
    wanted = replace(options, report=not output.no_report)
    with keeping_results(out):
        with run_progress(file.duration_s, quiet=session.as_json) as watch:
            result = run_and_resume.start_campaign(file, wanted, out, execution, force=output.force, on_progress=watch)
        shared = execution.shard is not None
        return conclude(result, report=wanted.report, as_json=session.as_json, film=not output.no_film, shared=shared)
