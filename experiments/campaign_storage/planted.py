"""Campaign with two runs that fail by design, which its output and exit status must report.

python experiments/campaign_storage/planted.py --out out/planted
"""

import json

import campaign_processes as processes

RUNS = 40
PLANTED = (11, 29)
FAR_M, INSIDE_M = -50.0, -8.0
"""Initial positions behind the target; the second one is within the keep-out sphere of 10 m."""


def main() -> int:
    options = processes.options(__doc__)
    starts = [INSIDE_M if run in PLANTED else FAR_M for run in range(RUNS)]
    (options.out / "cases.csv").write_text("\n".join(["initial.relative_position_m[1]", *map(str, starts), ""]))
    scenario = options.out / "planted.toml"
    scenario.write_text(
        'extends = "inspection"\nname = "planted"\nduration_s = 200.0\n\n[design]\nkind = "table"\nfile = "cases.csv"\n'
    )
    without = ("--set", "dispersions=[]")
    folder = options.out / "runs"
    process = processes.start(
        processes.command("campaign", scenario, *without, "--runs", RUNS, "--block-size", 8, "--out", folder, "--json")
    )
    printed, error = process.communicate()
    if process.returncode not in (0, 3):
        print(error)
        return 1
    found = json.loads(printed)["failures"]
    for failure in found:
        print(failure)
    print(f"exit status {process.returncode}; planted: {list(PLANTED)}")
    return int([failure["run_id"] for failure in found] != list(PLANTED) or process.returncode != 3)


if __name__ == "__main__":
    raise SystemExit(main())
