"""Compilation time with an empty cache and with a filled one, in a compilation cache of the benchmark's own."""

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
    """Context with compilation and trace caches in a temporary folder, in place of those of the process.

    At its begin, compiled programs in memory are dropped.
    """
    before, trace_folder = (
        [getattr(jax.config, name) for name in _SETTINGS],
        os.environ.get(trace_cache.FOLDER_VARIABLE),
    )
    with tempfile.TemporaryDirectory(prefix="rpojax-bench-") as folder:
        try:
            _configure_cache(folder, 0.0, -1)
            os.environ[trace_cache.FOLDER_VARIABLE] = str(Path(folder) / "traces")
            jax.clear_caches()
            yield Path(folder)
        finally:
            _configure_cache(*before)
            os.environ.pop(trace_cache.FOLDER_VARIABLE, None)
            if trace_folder is not None:
                os.environ[trace_cache.FOLDER_VARIABLE] = trace_folder


def _configure_cache(*values: object) -> None:
    for name, value in zip(_SETTINGS, values, strict=True):
        jax.config.update(name, value)
    # jax opens its cache once, at the first compilation, and would keep the former folder.
    compilation_cache.reset_cache()


def compile_cold_and_cached(compile_engine: Callable[[], BatchEngine]) -> tuple[BatchEngine, float]:
    """An engine compiled with an empty cache, and the time to compile it again from the cache [s].

    Tracing is part of both times. Dropping the programs in memory stands for a new process.
    """
    with temporary_cache():
        engine = compile_engine()
        jax.clear_caches()
        return engine, compile_engine().compile_s
