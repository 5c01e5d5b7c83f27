"""Processor time of a team per run-second, over that of one servicer of the same kind, measured in turns.

python experiments/several_observers/cost.py [--rounds 5] [--duration 400] [--methods none estimates boxes central]

Each program simulates a full batch on one core; the processor time of the process is taken, so that other work on the
machine counts little. The ratio is that of the least times of all rounds, in brackets that of the medians.
"""

import argparse
import os
import time

import numpy as np

import rpojax

if hasattr(os, "sched_setaffinity"):
    # On more cores the threads of a small batch wait for each other, which counts as processor time.
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
rpojax.prepare_process()

import jax  # noqa: E402

from rpojax.campaign.execution.batch_engine import BatchEngine  # noqa: E402
from rpojax.scenario.loading import scenario_loader  # noqa: E402

ALONE = "safety_ellipse"
TEAM = "cooperative_inspection"


def seconds(engine: BatchEngine) -> float:
    """Processor time for a second of one run [us]."""
    prepared = engine.prepare(1, np.arange(engine.capacity))
    begin = time.process_time()
    for segment in engine.simulate(prepared):
        segment.channels  # noqa: B018
    return 1e6 * (time.process_time() - begin) / (engine.capacity * engine.scenario.ticks * engine.scenario.tick_s)


def main() -> None:
    """Prints one line per method."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--duration", type=int, default=400)
    parser.add_argument("--methods", nargs="*", default=["none", "estimates", "boxes", "central"])
    arguments = parser.parse_args()
    short = [f"duration_s={arguments.duration}", "coverage.enabled=false", "requirements=[]"]
    files = {ALONE: scenario_loader.load(ALONE, short)}
    for method in arguments.methods:
        overrides = [*short, f"navigation.sharing={method}"]
        # Without messages nobody knows where the others are.
        overrides += ["team.keep_out_m=0"] if method == "none" else []
        files[method] = scenario_loader.load(TEAM, overrides)
    engines = {name: BatchEngine(file, devices=jax.devices()[:1]) for name, file in files.items()}
    times: dict[str, list[float]] = {name: [] for name in engines}
    for name, engine in engines.items():
        begin = time.process_time()
        seconds(engine)
        print(f"{name}: compiled in {time.process_time() - begin:.0f} s of processor time", flush=True)
    for _ in range(arguments.rounds):
        for name, engine in engines.items():
            times[name].append(seconds(engine))
    for name, found in times.items():
        least, middle = min(found) / min(times[ALONE]), float(np.median(found) / np.median(times[ALONE]))
        print(f"{name}: {min(found):.2f} us, {least:.2f} times ({middle:.2f})", flush=True)


if __name__ == "__main__":
    main()
