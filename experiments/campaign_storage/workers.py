"""Campaign with two worker processes, one of which is killed, compared with a campaign of one process.

python experiments/campaign_storage/workers.py --out out/workers
"""

import os
import signal
import subprocess
import time

import campaign_processes as processes


def workers_of(process: int) -> list[int]:
    """Process numbers of the workers of a campaign."""
    found = subprocess.run(
        ["pgrep", "-P", str(process), "-f", "rpojax.campaign.execution.worker_process"],
        capture_output=True,
        text=True,
        check=False,
    )
    return [int(line) for line in found.stdout.split()]


def main() -> int:
    options = processes.options(__doc__, runs=120, block_size=2)
    reference, shared = options.out / "reference", options.out / "shared"
    processes.start(processes.campaign(reference, options.runs, options.block_size)).communicate()
    process = processes.start(processes.campaign(shared, options.runs, options.block_size, "--workers", 2))
    while len(list((shared / "manifest").glob("*.json"))) < 3 and process.poll() is None:
        time.sleep(0.05)
    killed = workers_of(process.pid)[:1]
    for number in killed:
        os.kill(number, signal.SIGKILL)
    error = process.communicate()[1]
    unequal = processes.different(reference, shared)
    print(f"workers killed: {len(killed)}; exit status {process.returncode}: {error.strip().splitlines()[-1]}")
    print(
        f"arrays compared: {len(processes.arrays(reference))}; not equal to the last bit: {len(unequal)} {unequal[:3]}"
    )
    return int(not killed or process.returncode != 0 or bool(unequal))


if __name__ == "__main__":
    raise SystemExit(main())
