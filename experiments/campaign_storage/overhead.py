"""What storing costs: the same blocks computed with and without being written, in turn.

python experiments/campaign_storage/overhead.py --out out/overhead
"""

import argparse
import os
import shutil
import statistics
import time
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", "--xla_force_host_platform_device_count=1")

import jax

import rpojax
from rpojax.campaign import creation, flying
from rpojax.campaign.retention import Retention
from rpojax.campaign.store import Campaign


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--pairs", type=int, default=8)
    parser.add_argument("--block-size", type=int, default=256)
    parser.add_argument("--duration-s", type=float, default=1000.0)
    options = parser.parse_args()
    shutil.rmtree(options.out, ignore_errors=True)
    file = rpojax.load("inspection", [f"duration_s={options.duration_s}"])
    runs = options.block_size * (options.pairs + 1)
    asked = creation.describe(file, 0, runs, 0, options.block_size, Retention("none").recorded())
    creation.create(options.out, asked, force=False)
    result = Campaign(options.out)
    engine = flying.engine_of(asked, jax.devices()[:1])
    engine.compile(0)
    print(f"compiled in {engine.compile_s:.0f} s", flush=True)

    def computed(block: int) -> float:
        begin = time.perf_counter()
        ids = result.block_ids(block)
        rows = slice(0, engine.size)
        flown = flying.fly(engine, 0, ids, [], ids - ids[0], Retention("none"), lambda share, failed: None)
        flown.results(rows, engine)
        return time.perf_counter() - begin

    def stored(block: int) -> float:
        begin = time.perf_counter()
        flying.do_blocks(result, engine, [block], lambda share, failed: None)
        return time.perf_counter() - begin

    computed(0)
    stored(0)
    pairs = [(computed(block), stored(block)) for block in range(1, options.pairs + 1)]
    ratios = [with_storing / alone for alone, with_storing in pairs]
    differences = [with_storing - alone for alone, with_storing in pairs]
    for alone, with_storing in pairs:
        print(f"computed in {alone:.3f} s, computed and stored in {with_storing:.3f} s")
    size = sum(path.stat().st_size for path in options.out.rglob("*") if path.is_file())
    median = statistics.median(ratios)
    print(
        f"median of the differences: {1e3 * statistics.median(differences):.0f} ms a block of {options.block_size} runs"
    )
    print(f"median of the ratios: {100.0 * (median - 1.0):+.1f} %; {size / runs:.0f} B a run")
    return int(median > 1.03)


if __name__ == "__main__":
    raise SystemExit(main())
