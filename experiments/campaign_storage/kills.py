"""Twenty kill -9 at random moments, then a resume: is the campaign the one that nobody killed, value by value?

python experiments/campaign_storage/kills.py --out out/kills
"""

import argparse
import random
import shutil
import time
from pathlib import Path

import common


def kill_once(words: list[str], delay_s: float) -> bool:
    """Whether a process was still at work when it was killed after a time."""
    process = common.start(words)
    time.sleep(delay_s)
    alive = process.poll() is None
    process.kill()
    process.communicate()
    return alive


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--runs", type=int, default=120)
    parser.add_argument("--block-size", type=int, default=2)
    parser.add_argument("--longest-s", type=float, default=12.0)
    options = parser.parse_args()
    shutil.rmtree(options.out, ignore_errors=True)
    options.out.mkdir(parents=True)
    whole, broken = options.out / "whole", options.out / "broken"
    histories = ("--histories", "every:40+worst:3:min_range_m")
    process = common.start(common.campaign(whole, options.runs, options.block_size, *histories))
    print(process.communicate()[1].strip().splitlines()[-1], flush=True)

    moments = random.Random(0)
    killed = 0
    left: list[int] = []
    for _ in range(options.kills):
        begun = (broken / "campaign.json").is_file()
        words = (
            common.command("resume", broken)
            if begun
            else common.campaign(broken, options.runs, options.block_size, *histories)
        )
        killed += kill_once(words, moments.uniform(0.2, options.longest_s))
        left.append(len(list((broken / "manifest").glob("*.json"))) if broken.exists() else -1)
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
