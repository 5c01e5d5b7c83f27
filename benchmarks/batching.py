"""The closed loop batched over the last axis and by `jax.vmap`, in turns on one device; prints a Markdown table.

python -m benchmarks.batching [--runs 256] [--turns 3] [--scenario inspection] [--set KEY=VALUE]...
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

prepare_jax(cache=False)
set_loop_fusion_flag(rendered=False)

import jax  # noqa: E402  (after the settings that it reads once)

import rpojax  # noqa: E402
from rpojax.batching.batching_mode import BatchingMode  # noqa: E402
from rpojax.benchmark import closed_loop_speed, timing  # noqa: E402
from rpojax.benchmark.platform_info import processor_description  # noqa: E402
from rpojax.benchmark.timing import ElapsedTime  # noqa: E402
from rpojax.campaign.execution.batch_engine import BatchEngine  # noqa: E402
from rpojax.scenario.schema import ScenarioFile  # noqa: E402

PASSES = 3
"""Passes of a compiled loop in each turn, after one that warms up."""


@dataclass(frozen=True)
class Turn:
    """One compilation of the loop, and its fastest pass.

    Attributes:
        mode: how the runs are batched
        compiled: tracing and compiling both programs
        loop_compile_s: XLA's part of it for the loop [s]
        simulated: fastest pass through the scenario
    """

    mode: BatchingMode
    compiled: ElapsedTime
    loop_compile_s: float
    simulated: ElapsedTime


def take_turn(file: ScenarioFile, runs: int, mode: BatchingMode) -> Turn:
    """Compiles the loop with nothing in memory, and simulates the runs."""
    jax.clear_caches()
    made: list[BatchEngine] = []
    compiled = timing.time_call(
        lambda: made.append(closed_loop_speed.compile_engine(file, runs, jax.devices()[:1], mode))
    )
    simulated = timing.fastest_pass(lambda: closed_loop_speed.time_pass(made[0]), PASSES)
    return Turn(mode, compiled, made[0].loop_compile_s, simulated)


def table(turns: Sequence[Turn]) -> list[str]:
    """Markdown table of the least times of each mode, and their range over the turns [s]."""
    columns = {
        "tracing and compilation, wall clock": lambda turn: turn.compiled.wall_s,
        "the same, processor": lambda turn: turn.compiled.cpu_s,
        "loop by XLA, wall clock": lambda turn: turn.loop_compile_s,
        "simulation, wall clock": lambda turn: turn.simulated.wall_s,
        "simulation, processor": lambda turn: turn.simulated.cpu_s,
    }
    lines = [f"| [s] | {' | '.join(get_args(BatchingMode))} |", f"|---|{'---|' * len(get_args(BatchingMode))}"]
    for label, value in columns.items():
        times = [sorted(value(turn) for turn in turns if turn.mode == mode) for mode in get_args(BatchingMode)]
        cells = (f"**{each[0]:.2f}** (to {each[-1]:.2f})" for each in times)
        lines.append(f"| {label} | {' | '.join(cells)} |")
    return lines


def main() -> None:
    """Compares both ways of batching."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=256)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--scenario", default="inspection")
    parser.add_argument("--set", dest="overrides", action="append", default=["duration_s=400"])
    options = parser.parse_args()
    file = rpojax.load(options.scenario, options.overrides)
    turns = [take_turn(file, options.runs, mode) for _ in range(options.turns) for mode in get_args(BatchingMode)]
    where = f"{processor_description()}; jax {jax.__version__}"
    print(
        f"{options.runs} runs of {file.duration_s:g} s of `{file.name}`, {options.turns} turns, one device of {where}\n"
    )
    print("\n".join(table(turns)))


if __name__ == "__main__":
    main()
