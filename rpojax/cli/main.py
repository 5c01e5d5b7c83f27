"""Monte Carlo simulation of vision-based spacecraft rendezvous.

SCENARIO is the name of a packaged scenario, such as 'inspection', or a TOML file; `rpojax --version` shows the version.

Exit status: 0 done, and no run failed; 1 unexpected error; 2 bad input, nothing was written; 3 the campaign
finished, but some of its runs failed, or some pictures could not be used, or an estimated probability is not to be
trusted; 4 the campaign is unfinished: its disk is full, or blocks were given up after three workers died of them; 130
interrupted; 143 terminated. After 4, 130 and 143 finished blocks are stored, and `rpojax resume` continues.

A scenario may name a plugin, a Python file with metrics, sensors or flight software. It is code, and is executed only
with the option --allow-plugin, which every command takes.

Environment: compiled programs are kept in the user's cache folder unless RPOJAX_CACHE=off. There is one host device for
each core unless XLA_FLAGS says how many. RPOJAX_BATCHING=jax batches runs by jax.vmap, which is slower.
"""

import sys
from collections.abc import Callable, Sequence

import tyro

from rpojax.cli.command_parsing import add_command, parse
from rpojax.cli.commands.analysis.compare import compare
from rpojax.cli.commands.analysis.lincov import lincov
from rpojax.cli.commands.analysis.sensitivity import sensitivity
from rpojax.cli.commands.analysis.tune import tune
from rpojax.cli.commands.analysis.worst_case import worst_case
from rpojax.cli.commands.campaigns.bench import bench
from rpojax.cli.commands.campaigns.campaign import campaign
from rpojax.cli.commands.campaigns.probability import probability
from rpojax.cli.commands.campaigns.rerun import rerun
from rpojax.cli.commands.campaigns.resume import resume
from rpojax.cli.commands.campaigns.run import run
from rpojax.cli.commands.campaigns.status import status
from rpojax.cli.commands.output.bridge import bridge
from rpojax.cli.commands.output.export import export
from rpojax.cli.commands.output.export_bag import export_bag
from rpojax.cli.commands.output.export_rrd import export_rrd
from rpojax.cli.commands.output.film import film
from rpojax.cli.commands.output.report import report
from rpojax.cli.commands.scenarios.new import new
from rpojax.cli.commands.scenarios.schema import schema
from rpojax.cli.commands.scenarios.validate import validate
from rpojax.cli.commands.vision import detector, field
from rpojax.cli.commands.vision.calibrate_camera_model import calibrate_camera_model
from rpojax.cli.commands.vision.detect import detect
from rpojax.cli.environment_faults import environment_fault
from rpojax.cli.error_text import error_text
from rpojax.cli.exit_status import Status
from rpojax.cli.standard_streams import (
    OutputFailure,
    flush_output,
    prepare_streams,
    print_problem,
    printable_streams,
    silence_output,
)
from rpojax.errors import RpojaxError, UnfinishedError
from rpojax.runtime import signal_handling
from rpojax.runtime.warning_lines import silence_libraries
from rpojax.version import __version__

COMMANDS: tuple[Callable[..., int], ...] = (
    run,
    campaign,
    resume,
    status,
    rerun,
    compare,
    lincov,
    report,
    tune,
    sensitivity,
    worst_case,
    export,
    probability,
    export_bag,
    export_rrd,
    bridge,
    bench,
    film,
    new,
    validate,
    schema,
)
"""Commands in the order of `--help`, before those of the radiance field and the detector."""

VISION_COMMANDS: tuple[Callable[..., int], ...] = (detect, calibrate_camera_model)
"""Commands after those of the radiance field and the detector."""

_ALLOW_PLUGIN, _NO_CACHE = "--allow-plugin", "--no-cache"

app = tyro.extras.SubcommandApp()
for command in COMMANDS:
    add_command(app, command)
app.command(field.app, name="field", help="Train, evaluate and show radiance fields of targets.")
app.command(detector.app, name="detector", help="Make data for the detector, train it and evaluate it.")
for command in VISION_COMMANDS:
    add_command(app, command)

_NAMES: dict[str, Sequence[str]] = {
    **{command.__name__.replace("_", "-"): () for command in (*COMMANDS, *VISION_COMMANDS)},
    "field": [command.__name__ for command in field.COMMANDS],
    "detector": [command.__name__ for command in detector.COMMANDS],
}
"""Command -> its own commands."""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line `argv` (default: that of the process) and returns the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    prepare_streams()
    if arguments[:1] == ["--version"]:
        print(f"rpojax {__version__}")
        return Status.DONE
    silence_libraries()
    with printable_streams():
        try:
            return _status(arguments, "--json" in arguments)
        except KeyboardInterrupt as interrupt:
            word, status = signal_handling.ending(type(interrupt))
            print_problem("", f"{word}; {str(interrupt) or 'nothing was written'}", "--json" in arguments)
            return status


def _status(arguments: Sequence[str], as_json: bool) -> int:
    """Exit status of a command line; errors are printed."""
    try:
        words = _repeat_set_flag(_permit_plugin(arguments))
        status = parse(app, words, _NAMES, __doc__ or "")()
        flush_output()
        return status
    except BrokenPipeError:
        silence_output()  # the reader, such as `head`, closed the pipe
        return Status.DONE
    except OutputFailure as error:
        silence_output()
        print_problem("error", error_text(error), as_json=False)
        return Status.BAD_INPUT
    except UnfinishedError as error:
        print_problem("unfinished", error_text(error), as_json)
        return Status.UNFINISHED
    except RpojaxError as error:
        print_problem("error", error_text(error), as_json)
        return Status.BAD_INPUT
    except Exception as error:
        fault = environment_fault(error)
        if fault is None:
            raise
        if isinstance(fault, OutputFailure):
            silence_output()
        print_problem("error", error_text(fault), as_json)
        return Status.BAD_INPUT


def _permit_plugin(arguments: Sequence[str]) -> list[str]:
    """The arguments without `--allow-plugin`, which lets the process execute the plugins of scenarios."""
    words = [word for word in arguments if word != _ALLOW_PLUGIN]
    if len(words) < len(arguments):
        from rpojax.runtime.jax_environment import prepare_jax
        from rpojax.scenario.plugins import plugin_registry

        # Plugins import JAX when the scenario is loaded, before the command prepares it.
        prepare_jax(cache=_NO_CACHE not in words)
        plugin_registry.permit()
    return words


def _repeat_set_flag(arguments: Sequence[str]) -> list[str]:
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
