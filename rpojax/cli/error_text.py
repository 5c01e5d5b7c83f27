"""Errors as the command line tells them: in one line, arguments as options, faults of the environment as such."""

import os
import re
import traceback
from typing import Final

from rpojax.cli.standard_streams import output_failure
from rpojax.errors import RpojaxError
from rpojax.printable_text import cut

_VARIABLES_AT_START: Final = {name: text for name, text in os.environ.items() if name.startswith(("JAX_", "XLA_"))}
"""Variables that the user has set; this package sets others."""

_OPTIONS = {
    "external_stages": "external",
    "first_run": "run-id",
    "horizon_s": "horizon",
    "metrics": "metric",
    "overrides": "set",
    "real_time_factor": "real-time",
    "validation_runs": "judge",
}
"""Options that have another name than the argument."""


def error_text(error: RpojaxError) -> str:
    """Message of an error in one line, with names of arguments as options, and `--force` for `force=True`."""
    text = re.sub(r"\b([a-z_]+)=True\b", lambda found: _option(found[1]), " ".join(str(error).split()))
    names = ", ".join(error.arguments)
    return ", ".join(map(_option, error.arguments)) + text.removeprefix(names)


def _option(argument: str) -> str:
    return "--" + _OPTIONS.get(argument, argument).replace("_", "-")


def environment_fault(error: BaseException) -> RpojaxError | None:
    """Error of one line that tells of a fault of the environment; None if the exception is of another kind."""
    if isinstance(error, MemoryError):
        return RpojaxError("memory: found too little, expected more; fewer runs a block (--block-size) need less")
    if isinstance(error, OSError) and error.filename is None:
        return output_failure(error)
    if isinstance(error, OSError):
        return RpojaxError(
            f"{error.filename}: found {str(error.strerror).lower()}, expected a file or folder that can be used"
        )
    if _VARIABLES_AT_START and any(_is_of_jax(frame.filename) for frame in traceback.extract_tb(error.__traceback__)):
        text = str(error)
        named = {name: value for name, value in _VARIABLES_AT_START.items() if name in text or value in text}
        shown = ", ".join(f"{name}={cut(value, 60)}" for name, value in (named or _VARIABLES_AT_START).items())
        return RpojaxError(f"environment {shown}: found what JAX refuses ({text:.150}), expected values that it takes")
    return None


def _is_of_jax(filename: str) -> bool:
    return filename.endswith(("jax/_src/config.py", "jax/_src/xla_bridge.py", "jaxlib/xla_client.py"))
