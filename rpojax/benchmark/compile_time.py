"""Compilation time with an empty cache and with a filled one, in a compilation cache of the benchmark's own."""

from collections.abc import Callable

from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.runtime import jax_configuration


def compile_cold_and_cached(compile_engine: Callable[[], BatchEngine]) -> tuple[BatchEngine, float]:
    """An engine compiled with an empty cache, and the time to compile it again from the cache [s].

    Tracing is part of both times. Dropping the programs in memory stands for a new process.
    """
    with jax_configuration.temporary_cache():
        engine = compile_engine()
        jax_configuration.forget_programs()
        return engine, compile_engine().compile_s
