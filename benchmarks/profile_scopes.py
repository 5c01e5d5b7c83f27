"""Profile of the closed loop by named scope of the tick, on one device; prints a Markdown table.

python benchmarks/profile_scopes.py [--batch 256] [--scenario inspection] [--set KEY=VALUE]...
"""

import argparse
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

prepare_jax(cache=False)
set_loop_fusion_flag(rendered=False)

import jax  # noqa: E402  (after the settings that it reads once)
import numpy as np  # noqa: E402

import rpojax  # noqa: E402
from rpojax.benchmark import closed_loop_speed, operation_count  # noqa: E402
from rpojax.campaign.execution.batch_engine import BatchEngine  # noqa: E402
from rpojax.errors import RpojaxError  # noqa: E402

FUNCTION_LOOPS = "functions"
"""Scope of short loops that XLA compiles as functions: plant steps, for the most part."""


UNDISTURBED = 0.2
"""Quantile of the durations of an instruction that counts as its time: other work on the machine lengthens some."""


def events(folder: Path) -> Iterator[tuple[str, int]]:
    """Name and duration [ns] of every event of a trace."""
    for path in folder.rglob("*.xplane.pb"):
        for plane in jax.profiler.ProfileData.from_file(str(path)).planes:
            for line in plane.lines:
                for event in line.events:
                    yield event.name, round(event.duration_ns)


def profile(engine: BatchEngine) -> list[tuple[str, int, int]]:
    """Scope, instructions started and time [ns] of one pass of a batch, without other work of the host.

    The time of a loop or a branch is that of the instructions in it, so only these are counted. A short loop that XLA
    compiles as a function is one instruction, since the profile does not show its content. An instruction has the same
    time in each tick, the `UNDISTURBED` quantile.
    """
    closed_loop_speed.time_pass(engine)
    text = engine.loop_program.as_text()
    found = operation_count.instructions(text)
    scope_of = {each.name: each.scope for each in found if not each.contains_instructions}
    scope_of |= {each.name: FUNCTION_LOOPS for each in found if each.opcode == "call"}
    prepared = closed_loop_speed.prepare_runs(engine)
    durations = defaultdict[str, list[int]](list)
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder):
            closed_loop_speed.simulate_runs(engine, prepared)
        for name, duration in events(Path(folder)):
            if name in scope_of:
                durations[name].append(duration)
    if not durations:
        raise RpojaxError("profile: found no instruction of the loop, expected those that its text names")
    time_ns, started = Counter[str](), Counter[str]()
    for name, found_ns in durations.items():
        started[scope_of[name]] += len(found_ns)
        time_ns[scope_of[name]] += round(len(found_ns) * np.quantile(found_ns, UNDISTURBED))
    scopes = (*operation_count.SCOPES, FUNCTION_LOOPS, operation_count.COPIES, operation_count.OTHER)
    return [(scope, started[scope], time_ns[scope]) for scope in scopes]


def main() -> None:
    """Simulates a batch on one device under the profiler."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--scenario", default="inspection")
    parser.add_argument("--set", dest="overrides", action="append", default=["duration_s=200"])
    options = parser.parse_args()
    engine = closed_loop_speed.compile_engine(
        rpojax.load(options.scenario, options.overrides), options.batch, jax.devices()[:1]
    )
    rows = profile(engine)
    ticks = engine.scenario.ticks
    total = sum(time_ns for _, _, time_ns in rows)
    print("| scope | instructions per tick | us per tick | ns per run and tick | share |\n|---|---|---|---|---|")
    for scope, started, time_ns in [*rows, ("sum", sum(row[1] for row in rows), total)]:
        each = time_ns / ticks
        cells = (f"{started / ticks:.0f}", f"{each / 1e3:.0f}", f"{each / options.batch:.0f}")
        print(f"| {scope} | {' | '.join(cells)} | {100.0 * time_ns / total:.0f} % |")


if __name__ == "__main__":
    main()
