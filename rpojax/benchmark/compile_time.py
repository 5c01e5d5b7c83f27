"""Compilation time with an empty cache and with a filled one, in a compilation cache of the benchmark's own."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import jax
from jax.experimental.compilation_cache import compilation_cache

from rpojax.campaign.execution.batch_engine import BatchEngine

_SETTINGS = (
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)


@contextmanager
def temporary_cache() -> Iterator[Path]:
    """Context with the compilation cache in a temporary folder, in place of that of the process.

    At its begin, compiled programs in memory are dropped.
    """
    before = [getattr(jax.config, name) for name in _SETTINGS]
    with tempfile.TemporaryDirectory(prefix="rpojax-bench-") as folder:
        try:
            _configure_cache(folder, 0.0, -1)
            jax.clear_caches()
            yield Path(folder)
        finally:
            _configure_cache(*before)


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
