"""Counts the operations of the compiled loop of a scenario without phases, and digests what it gives to the last bit.

    python experiments/missions/count_without_phases.py [inspection]

Run with the package of two commits (PYTHONPATH) it tells without a clock whether one does more work than the other.
"""

import argparse
import hashlib
import json
from collections import Counter
from pathlib import Path

import numpy as np

from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

prepare_jax(cache=False)
set_loop_fusion_flag(rendered=False)

import jax  # noqa: E402

import rpojax  # noqa: E402
from rpojax.benchmark import operation_count  # noqa: E402
from rpojax.campaign.execution.batch_engine import BatchEngine  # noqa: E402
from rpojax.scenario.loading import scenario_loader  # noqa: E402

RUNS, DURATION_S, SEED = 32, 1000, 1


def digest(engine: BatchEngine) -> str:
    """SHA-1 of all channels of all runs."""
    found = hashlib.sha1()
    for segment in engine.simulate(engine.prepare(SEED, np.arange(RUNS))):
        for name, values in sorted(segment.channels.items()):
            found.update(name.encode() + np.ascontiguousarray(values).tobytes())
    return found.hexdigest()


def main() -> None:
    """Prints one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="inspection")
    file = scenario_loader.load(parser.parse_args().scenario, [f"duration_s={DURATION_S}"])
    engine = BatchEngine(file, RUNS, jax.devices()[:1])
    engine.compile()
    text = engine.loop_program.as_text()
    instructions = operation_count.instructions(text)
    counts = {
        "package": str(Path(rpojax.__file__).parent),
        "flops": round(engine.loop_program.cost_analysis()["flops"] / RUNS, 1),
        "instructions": len(instructions),
        "multiplications": text.count(" multiply("),
        "by_scope": Counter(each.scope for each in instructions),
        "channels": digest(engine),
    }
    print(json.dumps(counts))


if __name__ == "__main__":
    main()
