"""Monte Carlo simulation of vision-based spacecraft rendezvous.

SCENARIO is the name of a packaged scenario, such as 'inspection', or a TOML file; `rpojax --version` tells the version.

Exit status: 0 done, and all runs completed; 1 unexpected error; 2 bad input, nothing was written; 3 the campaign
finished, but some of its runs failed, or some pictures could not be used; 130 interrupted, finished blocks are kept
for `rpojax resume`.

Environment: compiled programs are kept in the user's cache folder unless RPOJAX_CACHE=off. There is one host device for
each core unless XLA_FLAGS says how many.
"""

import enum
import json
import os
import shlex
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction, arg

from rpojax import calibration_verb, console, detector_verbs, field_verbs, plan_verb
from rpojax.errors import OutputError, RpojaxError
from rpojax.machine import prepare_jax
from rpojax.version import __version__

if TYPE_CHECKING:
    import numpy as np

    from rpojax.campaign.store import Campaign
    from rpojax.report.film import Shot
    from rpojax.simulation.schema import ScenarioFile


class Status(enum.IntEnum):
    """Exit statuses; 1 is left to Python, for errors that nobody expected."""

    DONE = 0
    BAD_INPUT = 2
    SOME_FAILED = 3
    INTERRUPTED = 130


Source = Annotated[Positional[str], arg(metavar="SCENARIO", help="Packaged name or TOML file.")]
Folder = Annotated[Positional[Path], arg(metavar="DIR", help="Folder of a campaign.")]
Out = Annotated[Path, arg(metavar="DIR", help="Folder to make for the results.")]
Overrides = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(name="set", metavar="KEY=VALUE", help="Another value for a key of the scenario, in TOML; several may follow."),
]
Seed = Annotated[int, arg(metavar="S", help="Master seed.")]
Force = Annotated[bool, arg(help="Replace the folder if it holds a campaign.")]
AsJson = Annotated[bool, arg(name="json", help="JSON on stdout and no progress.")]
NoFilm = Annotated[bool, arg(help="Take no pictures of a rendered camera again for the report.")]
NoCache = Annotated[bool, arg(help="Compile anew and keep nothing of it.")]

_WORKER = "rpojax-worker"

app = tyro.extras.SubcommandApp()


@app.command
def run(
    scenario: Source,
    *,
    out: Out,
    seed: Seed = 0,
    run_id: Annotated[int, arg(metavar="I", help="Number of the run in its campaign.")] = 0,
    overrides: Overrides = (),
    block_size: Annotated[
        int, arg(metavar="N", help="That of the campaign, for the very same numbers to the last digit.")
    ] = 1,
    force: Force = False,
    no_film: NoFilm = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """One run with its full history: a campaign of one run, with its report."""
    file = _load(scenario, overrides)
    prepare_jax(cache=not no_cache)
    from rpojax.campaign import runner

    def work(watch: console.Watch) -> "Campaign":
        return runner.run_campaign(
            file, 1, out, seed, first_run=run_id, block_size=block_size, force=force, on_progress=watch
        )

    with _keeping(out):
        return _conclude(_fly(work, file.duration_s, as_json), report=True, as_json=as_json, film=not no_film)


@app.command
def campaign(
    scenario: Source,
    *,
    runs: Annotated[int, arg(metavar="N", help="Number of runs.")],
    out: Annotated[
        Path | None, arg(metavar="DIR", help="Folder to make for the results.", help_behavior_hint="(required)")
    ] = None,
    seed: Seed = 0,
    overrides: Overrides = (),
    block_size: Annotated[
        int | None,
        arg(
            metavar="N", help="Runs at once on a device.", help_behavior_hint="(default: 256 on a CPU, 4096 elsewhere)"
        ),
    ] = None,
    histories: Annotated[
        str, arg(metavar="N|I,J,...", help="Full histories to keep: of the first N runs, or of the runs listed.")
    ] = "8",
    force: Force = False,
    no_report: Annotated[bool, arg(help="Write no report.html, report.json and figures.")] = False,
    no_film: NoFilm = False,
    dry_run: Annotated[bool, arg(help="Fly nothing: show what the runs would draw, and what they would take.")] = False,
    plan: Annotated[Path | None, arg(metavar="FILE", help="Of a dry run: CSV file to write, one row a run.")] = None,
    speed: Annotated[
        float | None, arg(metavar="X", help="Of a dry run: run-seconds per second, as `rpojax bench` tells.")
    ] = None,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Many dispersed runs, with a report on them."""
    plan_verb.check(dry_run, plan, speed, out, force)
    file = _load(scenario, overrides)
    kept = _histories(histories, runs)
    prepare_jax(cache=not no_cache)
    from rpojax.campaign import admission, runner

    if dry_run:
        if out is not None:
            admission.check_folder(out, force)
        plan_verb.show(file, runs, seed, block_size, kept, plan, speed, as_json)
        return Status.DONE
    assert out is not None

    def work(watch: console.Watch) -> "Campaign":
        return runner.run_campaign(
            file, runs, out, seed, block_size=block_size, histories=kept, force=force, on_progress=watch
        )

    with _keeping(out):
        flown = _fly(work, file.duration_s, as_json)
        return _conclude(flown, report=not no_report, as_json=as_json, film=not no_film)


@app.command
def resume(directory: Folder, *, as_json: AsJson = False, no_cache: NoCache = False) -> int:
    """Complete an interrupted campaign and its report; one that is complete is left as it is, with exit status 0."""
    prepare_jax(cache=not no_cache)
    from rpojax.campaign import runner
    from rpojax.campaign.store import Campaign

    found = Campaign(directory)
    if not found.missing():
        _show(found, _report_of(found), as_json)
        return Status.DONE
    with _keeping(directory):
        result = _fly(
            lambda watch: runner.resume_campaign(directory, on_progress=watch), found.file.duration_s, as_json
        )
        return _conclude(result, report=True, as_json=as_json)


@app.command
def report(
    directory: Folder,
    *,
    run_id: Annotated[
        int | None, arg(metavar="I", help="Run to show in detail.", help_behavior_hint="(default: the median one)")
    ] = None,
    no_film: NoFilm = False,
    as_json: AsJson = False,
) -> int:
    """Write report.html, report.json and figures anew."""
    prepare_jax(cache=True)
    from rpojax.campaign.store import Campaign
    from rpojax.report.html import write_report
    from rpojax.report.summary import choose_run

    found = Campaign(directory)
    choose_run(found, run_id)
    with console.busy("writing the report", quiet=as_json):
        path = write_report(found, run_id, film=not no_film)
    _show(found, path, as_json)
    return Status.DONE


@app.command
def film(
    directory: Folder,
    *,
    out: Annotated[Path, arg(metavar="FILE", help="Film (.mp4, VP9 inside) or sheet of twelve stills (.png).")],
    run_id: Annotated[
        int | None, arg(metavar="I", help="Run to show.", help_behavior_hint="(default: the first with a kept history)")
    ] = None,
    every: Annotated[int, arg(metavar="N", help="Ticks from one picture of a film to the next.")] = 10,
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
    from rpojax.campaign import filming
    from rpojax.campaign.design import population_of
    from rpojax.campaign.store import Campaign
    from rpojax.report import film as drawing
    from rpojax.report.files import write_atomically

    found = Campaign(directory)
    file = filming.scenario_of(found.info)
    run, history = _history_of(found, file, run_id)
    end = filming.last_tick(history)
    ticks = drawing.stills(history, end) if suffix == ".png" else list(range(0, end, every))
    with console.counting("taking pictures", quiet=False) as watch:
        pictures = filming.pictures(file, found.info["seed"], run, history, ticks, population_of(found.info))
        shots = _counted(pictures, len(ticks), watch)
        if suffix == ".png":
            write_atomically(out, drawing.png(drawing.strip(shots)))
        else:
            drawing.write_film(shots, out)
    print(out)
    return Status.DONE


def _history_of(found: "Campaign", file: "ScenarioFile", run_id: int | None) -> "tuple[int, Mapping[str, np.ndarray]]":
    """Number and full history of a run, flown again where none is kept."""
    from rpojax.campaign import filming

    kept, first, runs = found.history_ids, found.info["first_run"], found.info["runs"]
    run = run_id if run_id is not None else (kept or [first])[0]
    if not first <= run < first + runs:
        raise RpojaxError(f"--run-id: found {run}, expected a run of this campaign, {first} to {first + runs - 1}")
    if run in kept:
        return run, found.history(run)
    flown: list[Mapping[str, np.ndarray]] = []

    def work(watch: console.Watch) -> "Campaign":
        flown.append(filming.fly_again(file, found.info, run, watch))
        return found

    _fly(work, file.duration_s, as_json=False)
    return run, flown[0]


def _counted(shots: "Iterable[Shot]", total: int, watch: Callable[..., None]) -> "Iterator[Shot]":
    for count, shot in enumerate(shots):
        yield shot
        watch(count + 1, total)


@app.command
def validate(scenario: Source, *, overrides: Overrides = (), as_json: AsJson = False) -> int:
    """Check a scenario without running it."""
    from rpojax.simulation import dispersed
    from rpojax.simulation import scenario as scenarios

    file = _load(scenario, overrides)
    content = {
        "name": file.name,
        "description": file.description,
        "duration_s": file.duration_s,
        "scenario_hash": scenarios.digest(file),
        "dispersions": dispersed.keys(file),
        "design": file.design.kind,
    }
    if as_json:
        _print_json(content)
    else:
        print(f"{file.name}: valid; {file.duration_s:g} s, {len(file.dispersions)} dispersions")
    return Status.DONE


@app.command
def schema() -> int:
    """JSON schema of a scenario, for editors and other tools."""
    from rpojax.simulation.schema import ScenarioFile

    _print_json(ScenarioFile.model_json_schema())
    return Status.DONE


@app.command
def bench(
    *,
    runs: Annotated[tuple[int, ...], arg(metavar="N", help="Batch sizes.")] = (1, 64, 512),
    duration_s: Annotated[float, arg(metavar="T", help="Simulated time of a run [s].")] = 200.0,
    as_json: AsJson = False,
) -> int:
    """Measure the closed loop alone, without metrics and storage; programs are compiled anew, timed apart."""
    file = _load("inspection", (f"duration_s={duration_s}",))
    prepare_jax(cache=False)
    from rpojax.campaign import benchmark

    benchmark.check(runs)
    with console.busy(f"timing batches of {', '.join(map(str, runs))} runs", quiet=as_json):
        speeds = benchmark.measure(file, runs)
    if as_json:
        _print_json(speeds)
    else:
        console.show_speeds(speeds)
    return Status.DONE


field = field_verbs.app.cli
app.command(field_verbs.app, name="field", help="Train, judge and show radiance fields of targets.")
detector = detector_verbs.app.cli
app.command(detector_verbs.app, name="detector", help="Make data for the detector, train it and judge it.")
detect = app.command(detector_verbs.detect)
calibrate = app.command(name="calibrate-camera-model")(calibration_verb.calibrate)


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
    except RpojaxError as error:
        print(f"rpojax: error: {' '.join(str(error).split())}", file=sys.stderr)
        return Status.BAD_INPUT
    except KeyboardInterrupt as interrupt:
        print(f"rpojax: interrupted; {str(interrupt) or 'nothing was written'}", file=sys.stderr)
        _abandon_worker()
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


def _load(source: str, overrides: Sequence[str]) -> "ScenarioFile":
    from rpojax.simulation import scenario

    return scenario.load(source, overrides)


def _histories(text: str, runs: int) -> list[int]:
    """Run numbers meant by `N` (the first ones) or `I,J,...`."""
    try:
        numbers = [int(part) for part in text.split(",") if part.strip()]
    except ValueError:
        numbers = [-1]
    if not numbers or min(numbers) < 0:
        raise RpojaxError(f"--histories: found {text!r}, expected a number of runs, or run numbers such as 0,17")
    return numbers if "," in text else list(range(min(numbers[0], runs)))


def _fly(work: "Callable[[console.Watch], Campaign]", duration_s: float, as_json: bool) -> "Campaign":
    """Result of `work`, which tells its progress and gives way to an interrupt at once, even while compiling."""
    results: list[Campaign] = []
    errors: list[BaseException] = []

    def target(watch: console.Watch) -> None:
        try:
            results.append(work(watch))
        except BaseException as error:
            errors.append(error)

    with console.watching(duration_s, quiet=as_json) as watch:
        worker = threading.Thread(target=target, args=(watch,), name=_WORKER, daemon=True)
        worker.start()
        worker.join()
    if errors:
        raise errors[0]
    return results[0]


def _abandon_worker() -> None:
    """Ends the process if a worker is still busy; an orderly end would wait for the compiler, or crash in it."""
    if any(thread.name == _WORKER for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(Status.INTERRUPTED)


@contextmanager
def _keeping(directory: Path) -> Iterator[None]:
    """On an interrupt, says what is kept and how to go on."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_kept(directory)) from None


def _kept(directory: Path) -> str:
    from rpojax.campaign.store import Campaign

    try:
        found = Campaign(directory)
    except RpojaxError:
        return "nothing was written"
    missing, folder = len(found.missing()), shlex.quote(str(directory))
    if missing == 0:
        return f"all runs are kept; write the report with: rpojax report {folder}"
    return f"{found.blocks - missing} of {found.blocks} blocks are kept; go on with: rpojax resume {folder}"


def _conclude(result: "Campaign", report: bool, as_json: bool, film: bool = True) -> int:
    """Writes the report if it is wanted, shows the results and returns the exit status."""
    from rpojax.report.html import write_report

    path = None
    if report:
        with console.busy("writing the report", quiet=as_json):
            path = write_report(result, film=film)
    _show(result, path, as_json)
    return Status.DONE if result.completed.all() else Status.SOME_FAILED


def _report_of(result: "Campaign") -> Path | None:
    path = result.directory / "report.html"
    return path if path.is_file() else None


def _show(result: "Campaign", path: Path | None, as_json: bool) -> None:
    from rpojax.report.summary import summarise

    summary = summarise(result)
    if as_json:
        _print_json({"directory": str(result.directory), "report": None if path is None else str(path), **summary})
    else:
        console.show_campaign(summary, result.directory, path)


def _print_json(content: object) -> None:
    print(json.dumps(content, indent=2, allow_nan=False))
