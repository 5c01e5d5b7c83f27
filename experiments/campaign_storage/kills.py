"""Twenty kill -9 at random moments, then a resume: is the campaign the one that nobody killed, value by value?

python experiments/campaign_storage/kills.py --out out/kills
"""

import random
import time
from pathlib import Path

import common


def kill_once(words: list[str], folder: Path, wait_for_work: bool, delay_s: float) -> bool:
    """Whether a process was still at work when it was killed, a time after its start or after its first block."""
    before = blocks_in(folder)
    process = common.start(words)
    while wait_for_work and blocks_in(folder) <= before and process.poll() is None:
        time.sleep(0.02)
    time.sleep(delay_s)
    alive = process.poll() is None
    process.kill()
    process.communicate()
    return alive


def blocks_in(folder: Path) -> int:
    """Finished blocks."""
    return len(list((folder / "manifest").glob("*.json")))


def main() -> int:
    options = common.options(__doc__, kills=20, runs=120, block_size=2, longest_s=12.0)
    whole, broken = options.out / "whole", options.out / "broken"
    histories = ("--histories", "every:40+worst:3:min_range_m")
    process = common.start(common.campaign(whole, options.runs, options.block_size, *histories))
    print(process.communicate()[1].strip().splitlines()[-1], flush=True)

    moments = random.Random(0)
    killed = 0
    left: list[int] = []
    for number in range(options.kills):
        begun = (broken / "campaign.json").is_file()
        words = (
            common.command("resume", broken)
            if begun
            else common.campaign(broken, options.runs, options.block_size, *histories)
        )
        # Every other kill comes while blocks are being done, the others anywhere, also before the folder is made.
        at_work = number % 2 == 1
        delay_s = moments.uniform(0.0, 2.0) if at_work else moments.uniform(0.2, options.longest_s)
        killed += kill_once(words, broken, at_work, delay_s)
        left.append(blocks_in(broken) if broken.exists() else -1)
    partial = common.partial_files(options.out)
    resumed = common.start(common.command("resume", broken))
    resumed.communicate()
    unequal = common.different(whole, broken)
    print(f"blocks done after each kill (-1: no folder): {left}")
    print(f"kills while at work: {killed} of {options.kills}; partial files left by them: {partial}")
    print(f"resume: exit status {resumed.returncode}; partial files after it: {common.partial_files(options.out)}")
    print(f"arrays compared: {len(common.arrays(whole))}; not equal to the last bit: {len(unequal)} {unequal[:3]}")
    return int(resumed.returncode != 0 or bool(unequal))


if __name__ == "__main__":
    raise SystemExit(main())
