"""A campaign on a local Dask cluster whose workers are killed twice: are the results those of one process?

python experiments/campaign_storage/dask_kills.py --out out/dask
"""

import os
import signal
import time
from typing import Any

import common
import distributed


def main() -> int:
    options = common.options(__doc__, workers=2)
    whole, spread = options.out / "whole", options.out / "spread"
    shape = (24, 2, "--histories", "2")
    common.start(common.campaign(whole, *shape)).communicate()
    os.environ |= common.ONE_DEVICE
    settings: dict[str, Any] = {"n_workers": options.workers, "threads_per_worker": 1, "dashboard_address": None}
    cluster: Any = distributed.LocalCluster(**settings)
    with cluster:
        address = cluster.scheduler_address
        process = common.start(common.campaign(spread, *shape, "--executor", "dask", "--scheduler", address))
        killed: list[int] = []
        for blocks in (1, 4):
            while len(list((spread / "manifest").glob("*.json"))) < blocks and process.poll() is None:
                time.sleep(0.1)
            client: Any = distributed.Client(address)
            with client:
                pids = list(client.run(os.getpid).values())
            os.kill(pids[0], signal.SIGKILL)
            killed.append(len(list((spread / "manifest").glob("*.json"))))
        end = process.communicate()[1].strip().splitlines()[-1]
    print(f"workers killed after {killed} blocks; exit status {process.returncode}: {end}")
    unequal = common.different(whole, spread)
    print(f"arrays not equal to those of one process: {len(unequal)} {unequal[:3]}")
    return int(process.returncode != 0 or bool(unequal))


if __name__ == "__main__":
    raise SystemExit(main())
