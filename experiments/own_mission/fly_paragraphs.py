"""Missions of one paragraph each, made by `rpojax new` and flown: how many of their runs are completed.

`python experiments/own_mission/fly_paragraphs.py --out DIR [--runs 64] [--seed 0] [--only NAME ...]`; the exit status
is 1 if a mission completes less than 95 % of its runs and nothing was warned of.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import rpojax

PARAGRAPHS = {
    "panels": (
        "A servicer of 120 kg with 1 N inspects a satellite with a bus of 3 m and 9 m across its panels, in a "
        "Sun-synchronous orbit at 550 km. It holds at 40 m and approaches to 15 m.",
        "--mass-kg 120 --thrust-n 1 --target-m 3 --span-m 9 --altitude-km 550 --hold-m 40 --approach-m 15",
        (),
    ),
    "cubesat": (
        "A 6U cubesat of 12 kg with 10 mN looks at a 1U cubesat from 10 m, at 400 km and 51.6 deg, with the Sun 30 deg "
        "out of the orbit plane.",
        "--mass-kg 12 --thrust-n 0.01 --target-m 0.1 --altitude-km 400 --inclination-deg 51.6 --beta-deg 30 "
        "--hold-m 10",
        (),
    ),
    "ring": (
        "A servicer of 600 kg with 1 N stays at 120 m behind a dead satellite near the geostationary ring: a bus of "
        "2 x 2 x 3 m, 30 m across its panels, turning by 0.1 deg/s.",
        "--mass-kg 600 --thrust-n 1 --target-m 2 2 3 --span-m 30 --altitude-km 35786 --hold-m 120 --tumble-deg-s 0.1",
        (),
    ),
    "smallsat": (
        "A smallsat of 12 kg with 25 mN at 800 km holds at 100 m from a satellite of half a metre.",
        "--mass-kg 12 --thrust-n 0.025 --target-m 0.5 --altitude-km 800 --hold-m 100",
        (),
    ),
    "stage": (
        "A tug of 250 kg with 4 N comes to an upper stage of 4 x 2 x 2 m that tumbles by 3 deg/s, at 700 km, with the "
        "node at 10:30: from 60 m to 20 m.",
        "--mass-kg 250 --thrust-n 4 --target-m 4 2 2 --altitude-km 700 --local-time-h 10.5 --hold-m 60 --approach-m 20 "
        "--tumble-deg-s 3",
        (),
    ),
}
"""Name -> paragraph, flags of `rpojax new`, and further changes as KEY=VALUE, at most ten."""
_LEAST_COMPLETED = 0.95


def rpojax_command(*words: str, folder: Path) -> str:
    """What a command prints on stderr; it ends the study if it fails."""
    done = subprocess.run(
        [sys.executable, "-m", "rpojax", *words],
        cwd=folder,
        check=False,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    if done.returncode not in (0, 3):  # 3: some of the runs failed
        raise SystemExit(done.stderr)
    return done.stderr


def fly(name: str, folder: Path, runs: int, seed: int) -> bool:
    """Makes and flies a mission; prints a row of the table, and says whether it is as it should be."""
    _, flags, changes = PARAGRAPHS[name]
    warned = rpojax_command("new", name, *flags.split(), "--force", folder=folder).strip()
    overrides = [word for change in changes for word in ("--set", change)]
    words = ["campaign", f"{name}.toml", "--runs", str(runs), "--seed", str(seed), "--out", name, "--no-film"]
    rpojax_command(*words, "--force", "--json", *overrides, folder=folder)
    campaign = rpojax.Campaign(folder / name)
    outcomes = [str(each) for each in campaign.outcomes]
    others = ", ".join(f"{outcomes.count(each)} {each}" for each in sorted({*outcomes} - {"completed"})) or "none"
    share = outcomes.count("completed") / runs
    error, least = campaign.metrics["formation_error_rms_m"], campaign.metrics["min_range_m"]
    print(
        f"| `{name}` | {len(changes)} | {outcomes.count('completed')} of {runs} | {others} | "
        f"{sorted(error)[len(error) // 2]:.2g} m | {max(error):.2g} m | {min(least):.3g} m | {warned or 'nothing'} |",
        flush=True,
    )
    return share >= _LEAST_COMPLETED or bool(warned)


def main() -> int:
    """Flies the missions; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=64)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=list(PARAGRAPHS), default=list(PARAGRAPHS))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    print("| mission | changes | completed | others | formation error, median | worst | least range | warned of |")
    print("|---|---|---|---|---|---|---|---|")
    good = [fly(name, options.out, options.runs, options.seed) for name in options.only]
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
