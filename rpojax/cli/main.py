"""Monte Carlo simulation of vision-based spacecraft rendezvous.

SCENARIO is the name of a packaged scenario, such as 'inspection', or a TOML file; `rpojax --version` shows the version.

Exit status: 0 done, and all runs completed; 1 unexpected error; 2 bad input, nothing was written; 3 the campaign
finished, but some of its runs failed, or some pictures could not be used, or an estimated probability is not to be
trusted; 4 the campaign is unfinished: its disk is full, or blocks were given up after three workers died of them; 130
interrupted. After 4 and 130 finished blocks are stored, and `rpojax resume` continues.

A scenario may name a plugin, a Python file with metrics, sensors or flight software. It is code, and is executed only
with the option --allow-plugin, which every command takes.

Environment: compiled programs are kept in the user's cache folder unless RPOJAX_CACHE=off. There is one host device for
each core unless XLA_FLAGS says how many. RPOJAX_BATCHING=jax batches runs by jax.vmap, which is slower.
"""

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress

import tyro
from tyro.conf import FlagCreatePairsOff, SuppressFixed

from rpojax.cli.commands import detector, field
from rpojax.cli.commands.bench import bench
from rpojax.cli.commands.bridge import bridge
from rpojax.cli.commands.calibrate_camera_model import calibrate_camera_model
from rpojax.cli.commands.campaign import campaign
from rpojax.cli.commands.compare import compare
from rpojax.cli.commands.detect import detect
from rpojax.cli.commands.export import export
from rpojax.cli.commands.export_bag import export_bag
from rpojax.cli.commands.export_rrd import export_rrd
from rpojax.cli.commands.film import film
from rpojax.cli.commands.lincov import lincov
from rpojax.cli.commands.new import new
from rpojax.cli.commands.probability import probability
from rpojax.cli.commands.report import report
from rpojax.cli.commands.rerun import rerun
from rpojax.cli.commands.resume import resume
from rpojax.cli.commands.run import run
from rpojax.cli.commands.schema import schema
from rpojax.cli.commands.sensitivity import sensitivity
from rpojax.cli.commands.status import status
from rpojax.cli.commands.tune import tune
from rpojax.cli.commands.validate import validate
from rpojax.cli.commands.worst_case import worst_case
from rpojax.cli.error_text import error_text
from rpojax.cli.exit_status import Status
from rpojax.cli.interruptible_work import abandon_worker
from rpojax.errors import RpojaxError, UnfinishedError
from rpojax.runtime.sign_of_life import SignOfLife
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
    app.command(name=command.__name__.replace("_", "-"))(command)
app.command(field.app, name="field", help="Train, evaluate and show radiance fields of targets.")
app.command(detector.app, name="detector", help="Make data for the detector, train it and evaluate it.")
for command in VISION_COMMANDS:
    app.command(name=command.__name__.replace("_", "-"))(command)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line `argv` (default: that of the process) and returns the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments[:1] == ["--version"]:
        print(f"rpojax {__version__}")
        return Status.DONE
    try:
        words = _repeat_set_flag(_permit_plugin(arguments))
        with nullcontext() if "--json" in words else SignOfLife(_say, "starting"):
            status = app.cli(prog="rpojax", description=__doc__, args=words, config=(FlagCreatePairsOff, SuppressFixed))
        sys.stdout.flush()
        return status
    except BrokenPipeError:
        # The reader, such as `head`, closed the pipe; flushing what is buffered at exit would fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return Status.DONE
    except UnfinishedError as error:
        print(f"rpojax: unfinished: {error_text(error)}", file=sys.stderr)
        return Status.UNFINISHED
    except RpojaxError as error:
        print(f"rpojax: error: {error_text(error)}", file=sys.stderr)
        return Status.BAD_INPUT
    except KeyboardInterrupt as interrupt:
        print(f"rpojax: interrupted; {str(interrupt) or 'nothing was written'}", file=sys.stderr)
        abandon_worker()
        return Status.INTERRUPTED


def _say(text: str) -> None:
    with suppress(OSError, ValueError):  # nobody reads it any more
        print(f"rpojax: {text}", file=sys.stderr, flush=True)


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
