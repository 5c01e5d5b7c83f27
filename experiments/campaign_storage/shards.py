"""Shards started at once onto one folder, one of them killed: do they share it, and does a resume do the rest?

python experiments/campaign_storage/shards.py --out out/shards
"""

import common


def main() -> int:
    options = common.options(__doc__, shards=3, runs=24, block_size=2)
    shape = (options.runs, options.block_size, "--histories", "2+worst:1:min_range_m")
    whole, shared = options.out / "whole", options.out / "shared"
    common.start(common.campaign(whole, *shape)).communicate()

    names = [f"{number}/{options.shards}" for number in range(1, options.shards + 1)]
    words = [common.campaign(shared, *shape, "--shard", name) for name in names]
    for line in words:
        line.remove("--no-report")
    processes = [common.start(line) for line in words]
    ends = [process.communicate()[1].strip().splitlines()[-1] for process in processes]
    for name, process, end in zip(names, processes, ends, strict=True):
        print(f"shard {name}: exit status {process.returncode}; {end}")
    unequal = common.different(whole, shared)
    report = (shared / "report.html").is_file()
    print(f"arrays not equal to those of one process: {len(unequal)} {unequal[:3]}; report there: {report}")

    other = common.start(common.campaign(shared, options.runs, options.block_size, "--shard", "1/2", "--seed", "9"))
    print(f"a shard of another seed: {other.communicate()[1].strip()} (exit status {other.returncode})")
    return int(bool(unequal) or not report or other.returncode != 2)


if __name__ == "__main__":
    raise SystemExit(main())
