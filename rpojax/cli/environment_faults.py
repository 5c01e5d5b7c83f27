"""Faults of the environment: variables that JAX cannot read, memory that is too small, folders that cannot be used."""

import os
import traceback
from typing import Final

from rpojax.cli.standard_streams import output_failure
from rpojax.errors import RpojaxError
from rpojax.printable_text import cut

_VARIABLES_AT_START: Final = {name: text for name, text in os.environ.items() if name.startswith(("JAX_", "XLA_"))}
"""Variables that the user has set; this package sets others."""


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
