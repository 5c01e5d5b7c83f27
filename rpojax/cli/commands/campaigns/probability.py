"""The command `rpojax probability`: how likely a run is to fail, also where plain runs hardly ever do."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from rpojax.analysis.reliability.search_settings import EstimateSettings, FailureChoice
from rpojax.cli.arguments import FLAT, Out, Overrides, Seed, Session, Source, load
from rpojax.cli.console import show_unused_keys
from rpojax.cli.exit_status import Status
from rpojax.cli.output_paths import claim_folder, resumable
from rpojax.cli.standard_streams import print_json
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag
from rpojax.runtime.progress import run_progress

if TYPE_CHECKING:
    from rpojax.analysis.reliability.simulated_failures.estimate_folder import RecordedEstimate


def probability(
    scenario: Source,
    choice: Annotated[FailureChoice, FLAT],
    settings: Annotated[EstimateSettings, FLAT],
    session: Annotated[Session, FLAT],
    *,
    out: Out,
    seed: Seed = 0,
    overrides: Overrides = (),
    force: Annotated[bool, arg(help="Replace another estimate in the folder.")] = False,
) -> int:
    """How likely a run is to break a requirement or a limit, or to end with an outcome; the same command resumes it."""
    from rpojax.analysis.reliability.simulated_failures.estimate_folder import RecordedEstimate

    file = load(scenario, overrides)
    show_unused_keys(file, quiet=session.as_json)
    return estimate(RecordedEstimate(file, choice, settings, seed), session, out, force)


def estimate(asked: "RecordedEstimate", session: Session, out: Path, force: bool = False) -> int:
    """Makes, resumes or shows the estimate in the folder `out`, and returns the exit status."""
    claim_folder(out)
    prepare_jax(cache=not session.no_cache)
    set_loop_fusion_flag(rendered=asked.file.camera.model == "rendered")
    from rpojax.analysis.reliability.simulated_failures.run_probability import run_probability

    with run_progress(asked.file.duration_s, quiet=session.as_json) as watch, resumable(out):
        content = run_probability(
            asked.file, asked.choice, asked.settings, asked.seed, out, force=force, on_progress=watch
        )
    return _present(content, session, out)


def resume_estimate(directory: Path, session: Session) -> int:
    """Completes the estimate in a folder, or shows the finished one, and returns the exit status.

    Raises:
        ResultError: the folder is not as it was written, or other versions of the packages began the estimate.
    """
    from rpojax.analysis.reliability.simulated_failures.estimate_folder import (
        EstimateFolder,
        read_estimate,
        read_result,
    )

    asked = read_estimate(directory)
    if EstimateFolder(directory).is_finished:
        return _present(read_result(directory), session, directory)
    return estimate(asked, session, directory)


def _present(content: dict[str, Any], session: Session, out: Path) -> int:
    """Writes the page of a finished estimate, prints it, and returns the exit status."""
    from rpojax.report.page.probability_page import write_page

    write_page(content, out)
    if session.as_json:
        print_json({"directory": str(out), **content})
    else:
        _show(content, out)
    return Status.DONE if content["trusted"] else Status.SOME_FAILED


def _show(content: dict[str, Any], out: Path) -> None:
    from rich.console import Console

    from rpojax.report.rare_failures import sentences

    console = Console(highlight=False)
    for sentence in sentences(content):
        console.print(sentence, soft_wrap=True, markup=False)
    for run in content["failing_runs"][:3]:
        console.print(f"  {run['distance_sigmas']:.2f} sigmas: {run['command']}", soft_wrap=True, markup=False)
    console.print(f"{out / 'probability.html'}, {out / 'probability.json'}", soft_wrap=True, markup=False)
