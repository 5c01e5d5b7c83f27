"""The command `rpojax rerun`: one run of a campaign again, compared with what was recorded."""

import sys
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rpojax.cli.arguments import AsJson, Folder, Force, NoCache, NoFilm, Out
from rpojax.cli.campaign_output import conclude, keeping_results
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag
from rpojax.runtime.progress import run_progress, stage

if TYPE_CHECKING:
    from rpojax.campaign.rerun import RerunResult


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
    """Repeat one run of a campaign with its full history, and compare it with the record."""
    with stage("starting", quiet=as_json, announce=False):
        prepare_jax(cache=not no_cache)
        from rpojax.campaign import rerun as again
        from rpojax.campaign.storage.campaign_folder import Campaign

    found = Campaign(directory)
    set_loop_fusion_flag(rendered=found.file.camera.model == "rendered")
    duration_s = float(found.configuration.scenario["duration_s"])
    with keeping_results(out), run_progress(duration_s, quiet=as_json) as watch:
        outcome = again.rerun(found, run_id, out, force=force, on_progress=watch)
    comparison = {"recorded": outcome.was_recorded, "different": sorted(outcome.differences)}
    if not as_json:
        print(f"rpojax: {_verdict(outcome)}", file=sys.stderr)
    return conclude(outcome.campaign, report=True, as_json=as_json, film=not no_film, more={"rerun": comparison})


def _verdict(outcome: "RerunResult") -> str:
    """Agreement of the repeated run with the record, in one sentence."""
    if not outcome.was_recorded:
        return "the campaign has not recorded this run yet, so there is nothing to compare it with"
    if not outcome.differences:
        return f"all {len(outcome.campaign.metrics)} metrics are those of the campaign, to the last bit"
    name, (before, now) = next(iter(sorted(outcome.differences.items())))
    example = f"{name}: {before!r} there, {now!r} here"
    return f"{len(outcome.differences)} metrics are not those of the campaign, such as {example}"
