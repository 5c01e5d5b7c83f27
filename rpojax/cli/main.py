"""Monte Carlo simulation of vision-based spacecraft rendezvous.

SCENARIO is the name of a packaged scenario, such as 'inspection', or a TOML file; `rpojax --version` tells the version.

Exit status: 0 done, and all runs completed; 1 unexpected error; 2 bad input, nothing was written; 3 the campaign
finished, but some of its runs failed, or some pictures could not be used; 4 the campaign is unfinished: its disk is
full, or blocks were given up after three workers died of them; 130 interrupted. After 4 and 130 finished blocks are
kept for `rpojax resume`.

Environment: compiled programs are kept in the user's cache folder unless RPOJAX_CACHE=off. There is one host device for
each core unless XLA_FLAGS says how many.
"""

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import FlagCreatePairsOff, arg

from rpojax.cli import console
from rpojax.cli.arguments import (
    AsJson,
    Folder,
    NoCache,
    Overrides,
    Source,
    Status,
    abandon_worker,
    fly,
    load,
    print_json,
)
from rpojax.cli.commands import bench as bench_command
from rpojax.cli.commands import bridge as bridge_command
from rpojax.cli.commands import calibrate_camera_model as calibrate_camera_model_command
from rpojax.cli.commands import campaign as campaign_command
from rpojax.cli.commands import compare as compare_command
from rpojax.cli.commands import detector as detector_command
from rpojax.cli.commands import export_bag as export_bag_command
from rpojax.cli.commands import export_rrd as export_rrd_command
from rpojax.cli.commands import field as field_command
from rpojax.cli.commands import lincov as lincov_command
from rpojax.cli.commands import sensitivity as sensitivity_command
from rpojax.cli.commands import tune as tune_command
from rpojax.cli.commands import worst_case as worst_case_command
from rpojax.errors import OutputError, RpojaxError, UnfinishedError
from rpojax.runtime.jax_environment import prepare_jax
from rpojax.version import __version__

if TYPE_CHECKING:
    import numpy as np

    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.report.figures.camera_film import Shot
    from rpojax.scenario.schema import ScenarioFile


app = tyro.extras.SubcommandApp()


run = app.command(campaign_command.run)
campaign = app.command(campaign_command.campaign)
resume = app.command(campaign_command.resume)
status = app.command(campaign_command.status)
rerun = app.command(campaign_command.rerun)
compare = app.command(compare_command.compare)
lincov = app.command(lincov_command.lincov)
report = app.command(campaign_command.report)
tune = app.command(tune_command.tune)
sensitivity = app.command(sensitivity_command.sensitivity)
worst_case = app.command(name="worst-case")(worst_case_command.worst_case)
export_bag = app.command(name="export-bag")(export_bag_command.export_bag)
export_rrd = app.command(name="export-rrd")(export_rrd_command.export_rrd)
bridge = app.command(bridge_command.bridge)
bench = app.command(bench_command.bench)


@app.command
def film(
    directory: Folder,
    *,
    out: Annotated[Path, arg(metavar="FILE", help="Film (.mp4) or sheet of twelve stills (.png).")],
    run_id: Annotated[
        int | None, arg(metavar="I", help="Run to show.", help_behavior_hint="(default: the first with a kept history)")
    ] = None,
    every: Annotated[int, arg(metavar="N", help="Ticks from one picture of a film to the next.")] = 10,
    codec: Annotated[str, arg(metavar="KIND", help="Of a film: vp9, or h264 (extra viz).")] = "vp9",
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
    no_cache: NoCache = False,
) -> int:
    """What the rendered camera of a run saw, with the detector's boxes; a run without a kept history is flown again."""
    suffix = out.suffix.lower()
    if suffix not in (".png", ".mp4"):
        raise OutputError(f"{out}: found suffix {out.suffix!r}, expected .png or .mp4")
    if out.exists() and not force:
        raise OutputError(f"{out}: exists already; --force replaces it")
    if every < 1:
        raise RpojaxError(f"--every: found {every}, expected at least 1")
    prepare_jax(cache=not no_cache)
    from rpojax.campaign import rerender
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.dispersions.designs import population_of
    from rpojax.report.atomic_output import write_atomically
    from rpojax.report.figures import camera_film as drawing

    drawing.check_codec(codec)
    found = Campaign(directory)
    file = rerender.scenario_of(found.info)
    run, history = _history_of(found, file, run_id)
    end = rerender.last_tick(history)
    ticks = drawing.stills(history, end) if suffix == ".png" else list(range(0, end, every))
    with console.counting("taking pictures", quiet=False) as watch:
        pictures = rerender.pictures(file, found.info["seed"], run, history, ticks, population_of(found.info))
        shots = _counted(pictures, len(ticks), watch)
        if suffix == ".png":
            write_atomically(out, drawing.png(drawing.strip(shots)))
        else:
            drawing.write_film(shots, out, codec)
    print(out)
    return Status.DONE


def _history_of(found: "Campaign", file: "ScenarioFile", run_id: int | None) -> "tuple[int, Mapping[str, np.ndarray]]":
    """Number and full history of a run, flown again where none is kept."""
    from rpojax.campaign import rerender
    from rpojax.campaign.rerun import check_run

    kept = found.history_ids
    run = run_id if run_id is not None else (kept or [found.asked["first_run"]])[0]
    check_run(found, run)
    if run in kept and rerender.can_show(history := found.history(run), file):
        return run, history
    flown: list[Mapping[str, np.ndarray]] = []

    def work(watch: console.Watch) -> "Campaign":
        flown.append(rerender.fly_again(file, found.info, run, watch))
        return found

    fly(work, file.duration_s, as_json=False)
    return run, flown[0]


def _counted(shots: "Iterable[Shot]", total: int, watch: Callable[..., None]) -> "Iterator[Shot]":
    for count, shot in enumerate(shots):
        yield shot
        watch(count + 1, total)


@app.command
def validate(scenario: Source, *, overrides: Overrides = (), as_json: AsJson = False) -> int:
    """Check a scenario without running it."""
    from rpojax.scenario import dispersion_keys
    from rpojax.scenario import scenario_file as scenarios

    file = load(scenario, overrides)
    content = {
        "name": file.name,
        "description": file.description,
        "duration_s": file.duration_s,
        "scenario_hash": scenarios.digest(file),
        "dispersions": dispersion_keys.keys(file),
        "design": file.design.kind,
    }
    if as_json:
        print_json(content)
    else:
        print(f"{file.name}: valid; {file.duration_s:g} s, {len(file.dispersions)} dispersions")
    return Status.DONE


@app.command
def schema() -> int:
    """JSON schema of a scenario, for editors and other tools."""
    from rpojax.scenario.schema import ScenarioFile

    print_json(ScenarioFile.model_json_schema())
    return Status.DONE


field = field_command.app.cli
app.command(field_command.app, name="field", help="Train, judge and show radiance fields of targets.")
detector = detector_command.app.cli
app.command(detector_command.app, name="detector", help="Make data for the detector, train it and judge it.")
detect = app.command(detector_command.detect)
calibrate_camera_model = app.command(name="calibrate-camera-model")(calibrate_camera_model_command.calibrate)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line `argv` (default: that of the process) and returns the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments[:1] == ["--version"]:
        print(f"rpojax {__version__}")
        return Status.DONE
    try:
        words = _spread(arguments)
        status = app.cli(prog="rpojax", description=__doc__, args=words, config=(FlagCreatePairsOff,))
        sys.stdout.flush()
        return status
    except BrokenPipeError:
        # The reader, such as `head`, has seen enough. What is still buffered would fail again when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return Status.DONE
    except UnfinishedError as error:
        print(f"rpojax: unfinished: {' '.join(str(error).split())}", file=sys.stderr)
        return Status.UNFINISHED
    except RpojaxError as error:
        print(f"rpojax: error: {' '.join(str(error).split())}", file=sys.stderr)
        return Status.BAD_INPUT
    except KeyboardInterrupt as interrupt:
        print(f"rpojax: interrupted; {str(interrupt) or 'nothing was written'}", file=sys.stderr)
        abandon_worker()
        return Status.INTERRUPTED


def _spread(arguments: Sequence[str]) -> list[str]:
    """`--set A=1 B=2` as `--set A=1 --set B=2`, so that a positional argument may follow."""
    words: list[str] = []
    inside = False
    for word in arguments:
        first = inside and words[-1] == "--set"
        inside = word == "--set" or first or (inside and "=" in word and not word.startswith("-"))
        if inside and not first and word != "--set":
            words.append("--set")
        words.append(word)
    return words
