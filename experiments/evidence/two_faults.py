"""Compares the closed loop with two faults to that with the first alone, and a run of a study to its replay.

python -m experiments.evidence.two_faults --out /tmp/two_faults

A star tracker is blind from 800 s on, and a wheel has friction from 2000 s on. Prints until when the histories of both
campaigns are equal to the last bit, and what differs first.
"""

import argparse
from pathlib import Path

import numpy as np

import rpojax

SECOND_S = 2000.0
COMMON = (
    "duration_s=3000",
    "requirements=[]",
    "limits.off_station_m=100",
    *(f"dispersions.faults.fault.{key}=none" for key in ("kind", "start_s", "severity", "wheel")),
    "faults.fault.kind=star_tracker_blind",
    "faults.fault.start_s=800",
)
SECOND = ("faults.second.kind=wheel_friction", f"faults.second.start_s={SECOND_S:g}", "faults.second.severity=0.8")


def history(name: str, overrides: tuple[str, ...], out: Path) -> dict[str, np.ndarray]:
    """History of run 0."""
    file = rpojax.load("inspection_faults", overrides)
    campaign = rpojax.run_campaign(file, runs=2, seed=3, out=out / name, histories=(0,))
    return campaign.history(0)


def main() -> None:
    """Prints the comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    alone, both = history("alone", COMMON, out), history("both", (*COMMON, *SECOND), out)
    assert alone.keys() == both.keys()
    time_s = np.arange(len(alone["range_m"]))
    differs = np.zeros(len(time_s), dtype=bool)
    for name, values in alone.items():
        if len(values) != len(time_s):
            continue
        other = both[name]
        unequal = (
            ~((values == other) | (np.isnan(values) & np.isnan(other))) if values.dtype.kind == "f" else values != other
        )
        rows = unequal.reshape(len(time_s), -1).any(axis=1)
        differs |= rows
        if rows.any():
            print(f"{name}: first differs at {time_s[rows][0]} s")
    first = time_s[differs][0] if differs.any() else None
    print(
        f"{len(alone)} channels of {len(time_s)} ticks; second fault from {SECOND_S:g} s; first difference at {first} s"
    )


if __name__ == "__main__":
    main()
