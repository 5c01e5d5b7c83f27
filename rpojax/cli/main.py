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

import pkgutil
import sys
from collections.abc import Callable, Sequence
from typing import Final

from rpojax.cli.command_parsing import parse
from rpojax.cli.error_text import environment_fault, error_text
from rpojax.cli.exit_status import Status
from rpojax.cli.options import analysis, campaigns, output, scenarios, vision
from rpojax.cli.options.arguments import Command, Group
from rpojax.cli.standard_streams import (
    OutputFailure,
    flush_output,
    prepare_streams,
    print_problem,
    printable_streams,
    silence_output,
)
from rpojax.errors import RpojaxError, UnfinishedError
from rpojax.runtime import blas_threads, signal_handling
from rpojax.runtime.jax_environment import prepare_jax
from rpojax.runtime.progress import stage
from rpojax.runtime.warning_lines import silence_libraries
from rpojax.version import __version__

COMMANDS: Final[dict[str, type[Command] | Group]] = {
    "run": campaigns.RunCommand,
    "campaign": campaigns.CampaignCommand,
    "resume": campaigns.ResumeCommand,
    "status": campaigns.StatusCommand,
    "rerun": campaigns.RerunCommand,
    "compare": analysis.CompareCommand,
    "lincov": analysis.LincovCommand,
    "report": output.ReportCommand,
    "tune": analysis.TuneCommand,
    "sensitivity": analysis.SensitivityCommand,
    "worst-case": analysis.WorstCaseCommand,
    "robustness": analysis.RobustnessCommand,
    "faults": analysis.FaultsCommand,
    "export": output.ExportCommand,
    "probability": campaigns.ProbabilityCommand,
    "export-bag": output.ExportBagCommand,
    "export-rrd": output.ExportRrdCommand,
    "bridge": output.BridgeCommand,
    "bench": campaigns.BenchCommand,
    "film": output.FilmCommand,
    "new": scenarios.NewCommand,
    "validate": scenarios.ValidateCommand,
    "show": scenarios.ShowCommand,
    "schema": scenarios.SchemaCommand,
    "field": Group(
        "Train, evaluate and show radiance fields of targets.",
        {
            "train": vision.TrainFieldCommand,
            "evaluate": vision.EvaluateFieldCommand,
            "render": vision.RenderFieldCommand,
        },
    ),
    "detector": Group(
        "Make data for the detector, train it, refine it in the closed loop and evaluate it.",
        {
            "data": vision.MakeDataCommand,
            "train": vision.TrainDetectorCommand,
            "refine": vision.RefineDetectorCommand,
            "evaluate": vision.EvaluateDetectorCommand,
        },
    ),
    "detect": vision.DetectCommand,
    "landmarks": vision.LandmarksCommand,
    "pose": Group(
        "Train and evaluate the network that finds landmarks in pictures.",
        {
            "train": vision.TrainPoseCommand,
            "evaluate": vision.EvaluatePoseCommand,
        },
    ),
    "calibrate-camera-model": vision.CalibrateCameraModelCommand,
}
"""The commands by name, in the order of `--help`."""

_ALLOW_PLUGIN, _NO_CACHE = {"--allow-plugin", "--allow_plugin"}, {"--no-cache", "--no_cache"}


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
        words = _repeat_set_flag([word for word in arguments if word not in _ALLOW_PLUGIN])
        command = parse(COMMANDS, words, __doc__ or "")
        status = _work(command, arguments, as_json)(command)
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


def _work(command: Command, arguments: Sequence[str], as_json: bool) -> Callable[[Command], int]:
    """Function that does the work of a command, imported when JAX is prepared and plugins are allowed or not.

    `--allow-plugin` lets the process execute the plugins of scenarios, which may import JAX.
    """
    allowed = bool(_ALLOW_PLUGIN & {*arguments})
    is_long = command.prepares_jax or allowed
    if is_long:
        prepare_jax(cache=command.keeps_programs and not _NO_CACHE & {*arguments})
    if command.has_small_matrices:
        blas_threads.start_with_one_thread()
    with stage("starting", quiet=as_json or not is_long, announce=False):
        if allowed:
            pkgutil.resolve_name("rpojax.scenario.plugins.plugin_registry:permit")()
        return pkgutil.resolve_name(f"rpojax.cli.commands.{command.work}")


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
