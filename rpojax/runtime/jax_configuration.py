"""Settings of JAX in this process: double precision, the compilation cache, and those that another process sends."""

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import jax
from jax.experimental.compilation_cache import compilation_cache

_CACHE_SETTINGS = (
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)

_SENT_VARIABLES = ("XLA_FLAGS", *(name.upper() for name in _CACHE_SETTINGS))
"""Environment variables that are sent to the workers of a cluster."""


def enable_double_precision() -> None:
    """Enables float64 in JAX: orbit radii are 7000 km and errors are millimetres."""
    jax.config.update("jax_enable_x64", True)


def sent_variables() -> dict[str, str]:
    """Environment variables of this process that JAX and XLA read, for a worker on another machine."""
    return {name: os.environ[name] for name in _SENT_VARIABLES if name in os.environ}


def apply_variables(variables: Mapping[str, str]) -> None:
    """Applies `sent_variables` of another process, except those that this process has set itself.

    Effective until the first program is compiled: equal flags give equal programs and thereby equal numbers.
    """
    for name, value in variables.items():
        if name in os.environ:
            continue
        if name == "XLA_FLAGS":
            os.environ[name] = value
        else:
            # jax has read its variables when it was imported.
            kind = {"DIR": str, "SECS": float, "BYTES": int}[name.rpartition("_")[2]]
            jax.config.update(name.lower(), kind(value))


@contextmanager
def temporary_cache() -> Iterator[Path]:
    """Context with the compilation cache in a temporary folder, in place of that of the process.

    At its begin, compiled programs in memory are dropped.
    """
    before = [getattr(jax.config, name) for name in _CACHE_SETTINGS]
    with tempfile.TemporaryDirectory(prefix="rpojax-cache-") as folder:
        try:
            _configure_cache(folder, 0.0, -1)
            forget_programs()
            yield Path(folder)
        finally:
            _configure_cache(*before)


def forget_programs() -> None:
    """Drops all traces and compiled programs of this process, as if it had just started."""
    jax.clear_caches()


def _configure_cache(*values: object) -> None:
    for name, value in zip(_CACHE_SETTINGS, values, strict=True):
        jax.config.update(name, value)
    # jax opens its cache once, at the first compilation, and would keep the former folder.
    compilation_cache.reset_cache()
