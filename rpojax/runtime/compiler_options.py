"""How XLA compiles the two programs of a campaign on a CPU."""

import os
from collections.abc import Mapping
from typing import Any

import jax

PREPARATION_OPTIONS: Mapping[str, Any] = {
    "xla_backend_optimization_level": 0,
    "xla_cpu_use_fusion_emitters": False,
    "xla_cpu_parallel_codegen_split_count": 1,
}
"""It works once for hundreds of ticks of the loop, so that it is compiled quickly rather than well, and on one core
beside the tracing of the loop."""

LOOP_OPTIONS: Mapping[str, Any] = {
    "xla_cpu_experimental_ynn_fusion_type": "",
    "xla_disable_hlo_passes": "reshape-mover",
}
"""No calls of another library for many small sums, and no pass that moves reshapes past one operation at a time, each
in a round of all the other passes."""


def compile_with_options(lowered: Any, cpu_options: Mapping[str, Any]) -> Any:
    """A program compiled with options where JAX computes on a CPU: what XLA knows and the user's flags leave open."""
    flags = os.environ.get("XLA_FLAGS", "")
    wanted = cpu_options if jax.default_backend() == "cpu" else {}
    options = {name: value for name, value in wanted.items() if f"--{name}" not in flags}
    while True:
        try:
            return lowered.compile(compiler_options=options or None)
        except jax.errors.JaxRuntimeError as error:
            unknown = [name for name in options if "No such compile option" in str(error) and name in str(error)]
            if not unknown:
                raise
            options.pop(unknown[0])
