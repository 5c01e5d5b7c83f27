"""What storing costs: the same blocks computed with and without being written, in turn.

python experiments/campaign_storage/overhead.py --out out/overhead
"""

import os
import statistics
import time

os.environ.setdefault("XLA_FLAGS", "--xla_force_host_platform_device_count=1")

import common
import jax

import rpojax
from rpojax.campaign.execution import block_runner
from rpojax.campaign.history_retention import Retention
from rpojax.campaign.storage import folder_creation
from rpojax.campaign.storage.campaign_folder import Campaign


def main() -> int:
    options = common.options(__doc__, pairs=8, block_size=256, duration_s=1000.0)
    file = rpojax.load("inspection", [f"duration_s={options.duration_s}"])
    runs = options.block_size * (options.pairs + 1)
    asked = folder_creation.new_configuration(file, 0, runs, 0, options.block_size, Retention("none").to_record())
    folder_creation.create_folder(options.out / "runs", asked, force=False)
    result = Campaign(options.out / "runs")
    engine = block_runner.engine_from_configuration(asked, jax.devices()[:1])
    engine.compile()
    print(f"compiled in {engine.compile_s:.0f} s", flush=True)

    def computed(block: int) -> float:
        begin = time.perf_counter()
        ids = result.block_run_ids(block)
        rows = slice(0, engine.runs_per_device)
        flown = block_runner.simulate_batch(
            engine, 0, ids, [], ids - ids[0], Retention("none"), lambda share, failed: None
        )
        flown.block_arrays(rows, engine)
        return time.perf_counter() - begin

    def stored(block: int) -> float:
        begin = time.perf_counter()
        block_runner.simulate_and_store(result, engine, [block], lambda share, failed: None)
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
