"""Campaign on a local Dask cluster with workers killed twice, compared with a campaign of one process.

python experiments/campaign_storage/dask_kills.py --out out/dask
"""

import os
import signal
import time
from typing import Any

import campaign_processes as processes
import distributed


def main() -> int:
    options = processes.options(__doc__, workers=2)
    reference, clustered = options.out / "reference", options.out / "clustered"
    shape = (24, 2, "--histories", "2")
    processes.start(processes.campaign(reference, *shape)).communicate()
    os.environ |= processes.ONE_DEVICE
    settings: dict[str, Any] = {"n_workers": options.workers, "threads_per_worker": 1, "dashboard_address": None}
    cluster: Any = distributed.LocalCluster(**settings)
    with cluster:
        address = cluster.scheduler_address
        process = processes.start(processes.campaign(clustered, *shape, "--executor", "dask", "--scheduler", address))
        killed: list[int] = []
        for blocks in (1, 4):
            while len(list((clustered / "manifest").glob("*.json"))) < blocks and process.poll() is None:
                time.sleep(0.1)
            client: Any = distributed.Client(address)
            with client:
                pids = list(client.run(os.getpid).values())
            os.kill(pids[0], signal.SIGKILL)
            killed.append(len(list((clustered / "manifest").glob("*.json"))))
        end = process.communicate()[1].strip().splitlines()[-1]
    print(f"workers killed after {killed} blocks; exit status {process.returncode}: {end}")
    unequal = processes.different(reference, clustered)
    print(f"arrays not equal to those of one process: {len(unequal)} {unequal[:3]}")
    return int(process.returncode != 0 or bool(unequal))


if __name__ == "__main__":
    raise SystemExit(main())
