"""Shards that share a folder, started at once, compared with a campaign of one process; a shard of another seed.

python experiments/campaign_storage/shards.py --out out/shards
"""

import campaign_processes as processes


def main() -> int:
    options = processes.options(__doc__, shards=3, runs=24, block_size=2)
    shape = (options.runs, options.block_size, "--histories", "2+worst:1:min_range_m")
    reference, shared = options.out / "reference", options.out / "shared"
    processes.start(processes.campaign(reference, *shape)).communicate()

    names = [f"{number}/{options.shards}" for number in range(1, options.shards + 1)]
    words = [processes.campaign(shared, *shape, "--shard", name) for name in names]
    for line in words:
        line.remove("--no-report")
    started = [processes.start(line) for line in words]
    messages = [process.communicate()[1].strip().splitlines()[-1] for process in started]
    for name, process, message in zip(names, started, messages, strict=True):
        print(f"shard {name}: exit status {process.returncode}; {message}")
    unequal = processes.different(reference, shared)
    report = (shared / "report.html").is_file()
    print(f"arrays not equal to those of one process: {len(unequal)} {unequal[:3]}; report written: {report}")

    other = processes.start(
        processes.campaign(shared, options.runs, options.block_size, "--shard", "1/2", "--seed", "9")
    )
    print(f"a shard of another seed: {other.communicate()[1].strip()} (exit status {other.returncode})")
    return int(bool(unequal) or not report or other.returncode != 2)


if __name__ == "__main__":
    raise SystemExit(main())
