"""Compilation by XLA, with options for the two programs of a campaign."""

import os
from collections.abc import Collection, Mapping
from functools import partial
from typing import Any

import jax

from rpojax.runtime.thread_pools import thread_pool

NO_OPTIONS: Mapping[str, Any] = {}

PREPARATION_OPTIONS: Mapping[str, Any] = {
    "xla_backend_optimization_level": 0,
    "xla_cpu_use_fusion_emitters": False,
    "xla_cpu_parallel_codegen_split_count": 1,
}
"""The preparation runs once per hundreds of ticks: quick compilation, on one core while the loop is traced."""

LOOP_OPTIONS: Mapping[str, Any] = {
    "xla_cpu_experimental_ynn_fusion_type": "",
    "xla_disable_hlo_passes": "reshape-mover",
}
"""No library calls for small sums; no reshape-mover, which runs all other passes again after each reshape it moves."""

GPU_OPTIONS: Mapping[str, Any] = {"xla_disable_hlo_passes": "triton-softmax-rewriter"}
"""XLA (of JAX 0.10) takes normalised vectors for softmax and fuses joined vectors into them, which it then refuses."""


def compile_in_threads(lowered: Collection[Any], cpu_options: Mapping[str, Any] = NO_OPTIONS) -> list[Any]:
    """Compiles programs at the same time, as `compile_with_options`; an interrupt is not held back."""
    with thread_pool(len(lowered)) as pool:
        return list(pool.map(partial(compile_with_options, cpu_options=cpu_options), lowered))


def compile_with_options(lowered: Any, cpu_options: Mapping[str, Any]) -> Any:
    """Compiles a program with those options of its backend that XLA knows and the user has not set by flags.

    On a CPU these are `cpu_options`, on a GPU `GPU_OPTIONS`.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    wanted = {"cpu": cpu_options, "gpu": GPU_OPTIONS}.get(jax.default_backend(), {})
    options = {name: value for name, value in wanted.items() if f"--{name}" not in flags}
    while True:
        try:
            return lowered.compile(compiler_options=options or None)
        except jax.errors.JaxRuntimeError as error:
            unknown = [name for name in options if "No such compile option" in str(error) and name in str(error)]
            if not unknown:
                raise
            options.pop(unknown[0])
