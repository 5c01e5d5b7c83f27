"""The command `rpojax run`: one run with its full history."""

from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.cli.arguments import AsJson, Force, NoCache, NoFilm, Out, Overrides, Seed, Source, load
from rpojax.cli.campaign_output import conclude, keeping_results
from rpojax.cli.console import show_warnings
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag
from rpojax.runtime.progress import run_progress, stage

if TYPE_CHECKING:
    pass


def run(
    scenario: Source,
    *,
    out: Out,
    seed: Seed = 0,
    run_id: Annotated[int, arg(metavar="I", help="Number of the run in its campaign.")] = 0,
    overrides: Overrides = (),
    block_size: Annotated[int, arg(metavar="N", help="Block size of its campaign, for bit-equal numbers.")] = 1,
    force: Force = False,
    no_film: NoFilm = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """One run with its full history: a campaign of one run, with its report."""
    file = load(scenario, overrides)
    show_warnings(file, quiet=as_json)
    with stage("starting", quiet=as_json, announce=False):
        prepare_jax(cache=not no_cache)
        set_loop_fusion_flag(rendered=file.camera.model == "rendered")
        from rpojax.campaign import run_and_resume

    options = CampaignOptions(runs=1, seed=seed, first_run=run_id, block_size=block_size, report=True)
    with keeping_results(out):
        with run_progress(file.duration_s, quiet=as_json) as watch:
            result = run_and_resume.start_campaign(file, options, out, force=force, on_progress=watch)
        return conclude(result, report=True, as_json=as_json, film=not no_film)
