"""Compiling for the first time and again, with a cache of compiled programs that nobody else uses."""

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import jax
from jax.experimental.compilation_cache import compilation_cache

from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.runtime import trace_cache

_SETTINGS = (
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)


@contextmanager
def temporary_cache() -> Iterator[Path]:
    """Compiled programs are kept in a new folder, as the command line keeps them in the user's, and then thrown away.

    What the process has compiled so far is forgotten when it begins.
    """
    before, kept = [getattr(jax.config, name) for name in _SETTINGS], os.environ.get(trace_cache.FOLDER_VARIABLE)
    with tempfile.TemporaryDirectory(prefix="rpojax-bench-") as folder:
        try:
            _configure_cache(folder, 0.0, -1)
            os.environ[trace_cache.FOLDER_VARIABLE] = str(Path(folder) / "traces")
            jax.clear_caches()
            yield Path(folder)
        finally:
            _configure_cache(*before)
            os.environ.pop(trace_cache.FOLDER_VARIABLE, None)
            if kept is not None:
                os.environ[trace_cache.FOLDER_VARIABLE] = kept


def _configure_cache(*values: object) -> None:
    for name, value in zip(_SETTINGS, values, strict=True):
        jax.config.update(name, value)
    # The cache is opened once, at the first compilation, and would stay where it was.
    compilation_cache.reset_cache()


def compile_cold_and_cached(prepare: Callable[[], BatchEngine]) -> tuple[BatchEngine, float]:
    """A compiled engine, compiled anew, and how long the next process takes to get the same one from the cache [s].

    Tracing is part of both times. Forgetting what the process has compiled stands for a new process.
    """
    with temporary_cache():
        engine = prepare()
        jax.clear_caches()
        return engine, prepare().compile_s
