"""Choice between batching over the last axis and `jax.vmap`, by the environment variable RPOJAX_BATCHING.

By default it is the last axis, or `jax.vmap` with a version of JAX that the former is not tested with.
"""

import functools
import os
import warnings
from collections.abc import Callable
from typing import Any, Literal, get_args

import jax

from rpojax.batching import jax_programs, vmap_last_axis
from rpojax.errors import Notice, RpojaxError

BatchingMode = Literal["last_axis", "jax"]

VARIABLE = "RPOJAX_BATCHING"
"""Environment variable with the mode; it is read when an engine is made or another batched function is traced."""

DEFAULT_MODE: BatchingMode = "last_axis"


def chosen_mode() -> BatchingMode:
    """The mode that the environment chooses, or else the default with the installed version of JAX.

    Raises:
        RpojaxError: the variable holds no mode.
    """
    return check_mode(VARIABLE, os.environ.get(VARIABLE) or _default_mode(jax.__version__))


def check_mode(name: str, mode: Any) -> BatchingMode:
    """The mode, checked to be one that exists.

    Raises:
        RpojaxError: there is no such mode; `name` says where it was found.
    """
    if mode not in get_args(BatchingMode):
        raise RpojaxError(f"{name}: found {mode!r:.60}, expected one of {', '.join(get_args(BatchingMode))}")
    return mode


@functools.cache
def _default_mode(version: str) -> BatchingMode:
    """The default mode, with one warning where the version of JAX does not allow it."""
    if jax_programs.is_known(tuple(map(int, version.split(".")[:2]))):
        return DEFAULT_MODE
    oldest, newest = ("{}.{}".format(*each) for each in jax_programs.KNOWN_VERSIONS)
    message = (
        f"jax {version}: found a version other than {oldest} to {newest}, so runs are batched by jax.vmap, which is "
        f"slower; {VARIABLE}=last_axis tries the faster batching all the same"
    )
    warnings.warn(message, Notice, stacklevel=2)
    return "jax"


def transform(mode: BatchingMode | None = None) -> Callable[..., Callable[..., Any]]:
    """Transform that batches a function over last axes, called as `jax.vmap`; by default that of the environment."""
    return jax.vmap if (mode or chosen_mode()) == "jax" else vmap_last_axis.vmap
