"""The command `rpojax probability`: how likely a run is to fail, also where plain runs hardly ever do."""

from pathlib import Path
from typing import Any

from rich.console import Console

from rpojax.analysis.reliability.simulated_failures.estimate_folder import (
    CONFIGURATION_NAME,
    EstimateFolder,
    RecordedEstimate,
    read_estimate,
    read_result,
)
from rpojax.analysis.reliability.simulated_failures.run_probability import run_probability
from rpojax.cli.exit_status import Status
from rpojax.cli.options.arguments import Session
from rpojax.cli.options.campaigns import ProbabilityCommand
from rpojax.cli.output_paths import claim_folder, resumable
from rpojax.cli.scenario_files import fuse_loops_of, load, show_unused_keys
from rpojax.cli.standard_streams import print_json
from rpojax.report.page.probability_page import write_page
from rpojax.report.rare_failures import sentences
from rpojax.runtime.progress import run_progress


def probability(asked: ProbabilityCommand) -> int:
    """Does the work of the command; returns its exit status."""
    file = load(asked.scenario, asked.overrides)
    show_unused_keys(file, quiet=asked.session.as_json)
    return estimate(
        RecordedEstimate(file, asked.choice, asked.settings, asked.seed), asked.session, asked.out, asked.force
    )


def estimate(asked: RecordedEstimate, session: Session, out: Path, force: bool = False) -> int:
    """Makes, resumes or shows the estimate in the folder `out`, and returns the exit status."""
    claim_folder(out)
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
    folder = EstimateFolder(directory)
    fuse_loops_of(folder.read(CONFIGURATION_NAME).get("scenario", {}))
    asked = read_estimate(directory)
    if folder.is_finished:
        return _present(read_result(directory), session, directory)
    return estimate(asked, session, directory)


def _present(content: dict[str, Any], session: Session, out: Path) -> int:
    """Writes the page of a finished estimate, prints it, and returns the exit status."""
    write_page(content, out)
    if session.as_json:
        print_json({"directory": str(out), **content})
    else:
        _show(content, out)
    return Status.DONE if content["trusted"] else Status.SOME_FAILED


def _show(content: dict[str, Any], out: Path) -> None:
    console = Console(highlight=False)
    for sentence in sentences(content):
        console.print(sentence, soft_wrap=True, markup=False)
    for run in content["failing_runs"][:3]:
        console.print(f"  {run['distance_sigmas']:.2f} sigmas: {run['command']}", soft_wrap=True, markup=False)
    console.print(f"{out / 'probability.html'}, {out / 'probability.json'}", soft_wrap=True, markup=False)
