"""Choice between batching over the last axis and `jax.vmap`, by the environment variable RPOJAX_BATCHING."""

import os
from collections.abc import Callable
from typing import Any, Literal, get_args

import jax

from rpojax.batching import vmap_last_axis
from rpojax.errors import RpojaxError

BatchingMode = Literal["last_axis", "jax"]

VARIABLE = "RPOJAX_BATCHING"
"""Environment variable with the mode; it is read when an engine is made or another batched function is traced."""

DEFAULT_MODE: BatchingMode = "last_axis"


def chosen_mode() -> BatchingMode:
    """The mode that the environment chooses.

    Raises:
        RpojaxError: the variable holds no mode.
    """
    return check_mode(VARIABLE, os.environ.get(VARIABLE) or DEFAULT_MODE)


def check_mode(name: str, mode: Any) -> BatchingMode:
    """The mode, if it is one.

    Raises:
        RpojaxError: it is none; `name` says where it was found.
    """
    if mode not in get_args(BatchingMode):
        raise RpojaxError(f"{name}: found {mode!r:.60}, expected one of {', '.join(get_args(BatchingMode))}")
    return mode


def transform(mode: BatchingMode | None = None) -> Callable[..., Callable[..., Any]]:
    """Transform that batches a function over last axes, called as `jax.vmap`; by default that of the environment."""
    return jax.vmap if (mode or chosen_mode()) == "jax" else vmap_last_axis.vmap
