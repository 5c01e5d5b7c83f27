"""Aborts at random instants of the last hundred metres: does the drift after them keep clear for a day?

python experiments/close_range/aborts.py --out DIR [--scenario NAME] [--runs 200] [--seed 0] [--set KEY=VALUE ...]

Every run is told to abort at an instant between its begin and its end, once with all thrusters and
once with one of them off from that instant on, and goes on for at least twenty minutes. A run keeps clear if the true
servicer stays outside of the keep-out sphere until its end, and in the free drift of a day after it. The exit status is
1 if fewer than 99 % do in either table.
"""

import argparse
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np

import rpojax
from rpojax.metrics.passive_safety import FINAL_DRIFT_RANGE
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

GOES_ON_S: Final = 1200.0
"""Time of a run after the latest abort [s]."""
LEAST_SHARE: Final = 0.99
"""Requirement on the share of runs that keep clear [-]."""


def main() -> int:
    """Simulates both campaigns and prints what their runs show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, type=Path)
    parser.add_argument("--scenario", default="final_approach")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--set", nargs="*", default=[], dest="changes")
    options = parser.parse_args()
    rpojax.prepare_process()
    holds = True
    for name, fails in (("all_thrusters", False), ("one_off", True)):
        file = _with_aborts(rpojax.load(options.scenario, options.changes), options.runs, options.seed, fails)
        campaign = rpojax.run_campaign(file, runs=options.runs, out=options.out / name, seed=options.seed)
        holds &= _prints(name, file, campaign)
    return int(not holds)


def _with_aborts(file: ScenarioFile, runs: int, seed: int, fails: bool) -> ScenarioFile:
    """A scenario with a random instant of the abort for every run, and a thruster that `fails` then."""
    tables: dict[str, Any] = file.model_dump(mode="json")
    random = np.random.default_rng(seed)
    instants = random.uniform(0.0, tables["duration_s"], runs).tolist()
    thrusters = random.integers(0, len(tables["thrusters"]), runs).tolist()
    values: dict[str, list[float]] = {"mission.abort_at_s": instants}
    if fails:
        tables["effects"]["faults"] = True
        tables["faults"] = [{"name": "fault", "kind": "thruster_off"}]
        values |= {"faults.fault.start_s": instants, "faults.fault.thruster": thrusters}
    tables["duration_s"] += GOES_ON_S
    tables["design"] = {"kind": "table", "values": values}
    return scenario_loader.validate(tables)


def _prints(name: str, file: ScenarioFile, campaign: rpojax.Campaign) -> bool:
    """Prints a table of one campaign; whether enough of its runs keep clear."""
    keep_out = file.limits.keep_out_m
    drift = campaign.metrics[FINAL_DRIFT_RANGE]
    entered = campaign.outcomes == "keep_out"
    # A run that was frozen has no drift; one without a finite state keeps clear of nothing.
    clear = ~entered & (np.nan_to_num(drift) >= keep_out)
    share = float(np.mean(clear))
    outcomes, counts = np.unique(campaign.outcomes, return_counts=True)
    print(f"\n{name}: {', '.join(f'{count} {each}' for each, count in zip(outcomes, counts, strict=True))}")
    print(f"keeps clear of {keep_out:g} m for a day: {int(clear.sum())} of {len(clear)}, {share:.1%}")
    known = np.isfinite(drift)
    ranges = np.percentile(drift[known], [0, 1, 5, 50, 95])
    print("least range of the drift, least, 1, 5, 50, 95 %: " + ", ".join(f"{each:.2f}" for each in ranges) + " m")
    burnt = campaign.metrics["delta_v_m_s"][known]
    print(f"delta-v, median and greatest: {np.median(burnt):.2f}, {burnt.max():.2f} m/s")
    values = file.design.model_dump()["values"]
    for run in np.flatnonzero(~clear):
        told = ", ".join(f"{key} {column[run]:g}" for key, column in values.items())
        print(f"run {run}: {campaign.outcomes[run]}, {told}, drift {drift[run]:.2f} m")
    return share >= LEAST_SHARE


if __name__ == "__main__":
    sys.exit(main())
