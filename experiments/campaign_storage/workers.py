"""Two worker processes, one of which is killed at work: does the campaign come out the same?

python experiments/campaign_storage/workers.py --out out/workers
"""

import os
import signal
import subprocess
import time

import common


def workers_of(process: int) -> list[int]:
    """Numbers of the worker processes of a campaign's process."""
    found = subprocess.run(
        ["pgrep", "-P", str(process), "-f", "rpojax.campaign.execution.worker_process"],
        capture_output=True,
        text=True,
        check=False,
    )
    return [int(line) for line in found.stdout.split()]


def main() -> int:
    options = common.options(__doc__, runs=120, block_size=2)
    whole, shared = options.out / "whole", options.out / "shared"
    common.start(common.campaign(whole, options.runs, options.block_size)).communicate()
    process = common.start(common.campaign(shared, options.runs, options.block_size, "--workers", 2))
    while len(list((shared / "manifest").glob("*.json"))) < 3 and process.poll() is None:
        time.sleep(0.05)
    killed = workers_of(process.pid)[:1]
    for number in killed:
        os.kill(number, signal.SIGKILL)
    said = process.communicate()[1]
    unequal = common.different(whole, shared)
    print(f"workers killed: {len(killed)}; exit status {process.returncode}: {said.strip().splitlines()[-1]}")
    print(f"arrays compared: {len(common.arrays(whole))}; not equal to the last bit: {len(unequal)} {unequal[:3]}")
    return int(not killed or process.returncode != 0 or bool(unequal))


if __name__ == "__main__":
    raise SystemExit(main())
