"""Cost of storage: the same blocks simulated with and without being stored, alternately.

python experiments/campaign_storage/overhead.py --out out/overhead
"""

import os
import statistics
import time

os.environ.setdefault("XLA_FLAGS", "--xla_force_host_platform_device_count=1")

import campaign_processes as processes
import jax

import rpojax
from rpojax.campaign.execution import block_runner, campaign_engine
from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage import folder_creation
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.campaign.storage.provenance import new_configuration


def main() -> int:
    options = processes.options(__doc__, pairs=8, block_size=256, duration_s=1000.0)
    file = rpojax.load("inspection", [f"duration_s={options.duration_s}"])
    runs = options.block_size * (options.pairs + 1)
    chosen = CampaignOptions(runs, block_size=options.block_size, histories=Retention("none"))
    configuration = new_configuration(file, chosen)
    folder_creation.create_folder(options.out / "runs", configuration, force=False)
    campaign = Campaign(options.out / "runs")
    engine = campaign_engine.recreate_engine(configuration, jax.devices()[:1])
    engine.compile()
    print(f"compiled in {engine.compile_s:.0f} s", flush=True)

    def time_simulation(block: int) -> float:
        begin = time.perf_counter()
        run_ids = campaign.block_run_ids(block)
        rows = slice(0, engine.runs_per_device)
        batch = block_runner.simulate_batch(
            engine, 0, run_ids, [], run_ids - run_ids[0], Retention("none"), lambda fraction, failed: None
        )
        batch.block_arrays(rows, engine)
        return time.perf_counter() - begin

    def time_simulation_and_storage(block: int) -> float:
        begin = time.perf_counter()
        block_runner.simulate_and_store(campaign, engine, [block], lambda fraction, failed: None)
        return time.perf_counter() - begin

    time_simulation(0)
    time_simulation_and_storage(0)
    pairs = [(time_simulation(block), time_simulation_and_storage(block)) for block in range(1, options.pairs + 1)]
    ratios = [with_storing / alone for alone, with_storing in pairs]
    differences = [with_storing - alone for alone, with_storing in pairs]
    for alone, with_storing in pairs:
        print(f"simulated in {alone:.3f} s, simulated and stored in {with_storing:.3f} s")
    size = sum(path.stat().st_size for path in options.out.rglob("*") if path.is_file())
    median = statistics.median(ratios)
    difference_ms = 1e3 * statistics.median(differences)
    print(f"median of the differences: {difference_ms:.0f} ms per block of {options.block_size} runs")
    print(f"median of the ratios: {100.0 * (median - 1.0):+.1f} %; {size / runs:.0f} B per run")
    return int(median > 1.03)


if __name__ == "__main__":
    raise SystemExit(main())
