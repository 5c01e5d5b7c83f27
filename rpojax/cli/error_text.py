"""Errors as the command line tells them: arguments as options, in one line."""

import re

from rpojax.errors import RpojaxError

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
