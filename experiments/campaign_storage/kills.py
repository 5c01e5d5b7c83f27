"""Campaign killed (kill -9) at twenty random times and resumed, compared with an uninterrupted campaign.

python experiments/campaign_storage/kills.py --out out/kills
"""

import random
import time
from pathlib import Path

import campaign_processes as processes


def kill_once(words: list[str], folder: Path, wait_for_work: bool, delay_s: float) -> bool:
    """Kills a process a time after its start or its first new block; whether it was still running."""
    before = blocks_in(folder)
    process = processes.start(words)
    while wait_for_work and blocks_in(folder) <= before and process.poll() is None:
        time.sleep(0.02)
    time.sleep(delay_s)
    alive = process.poll() is None
    process.kill()
    process.communicate()
    return alive


def blocks_in(folder: Path) -> int:
    """Number of finished blocks."""
    return len(list((folder / "manifest").glob("*.json")))


def main() -> int:
    options = processes.options(__doc__, kills=20, runs=120, block_size=2, longest_s=12.0)
    reference, interrupted = options.out / "reference", options.out / "interrupted"
    histories = ("--histories", "every:40+worst:3:min_range_m")
    process = processes.start(processes.campaign(reference, options.runs, options.block_size, *histories))
    print(process.communicate()[1].strip().splitlines()[-1], flush=True)

    times = random.Random(0)
    killed = 0
    left: list[int] = []
    for number in range(options.kills):
        begun = (interrupted / "campaign.json").is_file()
        words = (
            processes.command("resume", interrupted)
            if begun
            else processes.campaign(interrupted, options.runs, options.block_size, *histories)
        )
        # Every other kill comes during the simulation of blocks, the others at any time, also before the folder exists.
        at_work = number % 2 == 1
        delay_s = times.uniform(0.0, 2.0) if at_work else times.uniform(0.2, options.longest_s)
        killed += kill_once(words, interrupted, at_work, delay_s)
        left.append(blocks_in(interrupted) if interrupted.exists() else -1)
    partial = processes.partial_files(options.out)
    resumed = processes.start(processes.command("resume", interrupted))
    resumed.communicate()
    unequal = processes.different(reference, interrupted)
    print(f"blocks done after each kill (-1: no folder): {left}")
    print(f"kills of a running process: {killed} of {options.kills}; partial files left by them: {partial}")
    print(f"resume: exit status {resumed.returncode}; partial files after it: {processes.partial_files(options.out)}")
    print(
        f"arrays compared: {len(processes.arrays(reference))}; not equal to the last bit: {len(unequal)} {unequal[:3]}"
    )
    return int(resumed.returncode != 0 or bool(unequal))


if __name__ == "__main__":
    raise SystemExit(main())
