"""Device memory: what a program needs, what a process has used, and sizes that do not fit."""

from collections.abc import Callable
from typing import Any

import jax


def measured_or_reason(measure: Callable[[], dict[str, Any]], **label: Any) -> dict[str, Any]:
    """An entry with its label, or with the reason `not_measured` if the device has not enough memory."""
    try:
        return {**label, **measure()}
    except jax.errors.JaxRuntimeError as error:
        if "RESOURCE_EXHAUSTED" not in str(error):
            raise
        return {**label, "not_measured": f"memory: {' '.join(str(error).split()):.200}"}


def bytes_per_run(program: Any, runs: int) -> float | None:
    """Memory of arguments, results and temporary values of a compiled program, for each of its runs [B].

    None on a backend that does not tell.
    """
    needed = program.memory_analysis()
    if needed is None:
        return None
    total = needed.argument_size_in_bytes + needed.output_size_in_bytes + needed.temp_size_in_bytes
    return (total - needed.alias_size_in_bytes) / runs


def peak_bytes() -> int | None:
    """Largest memory that this process has used on the first device so far [B]; None on a CPU."""
    statistics = jax.devices()[0].memory_stats()
    return statistics.get("peak_bytes_in_use") if statistics else None
