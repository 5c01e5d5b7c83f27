"""Commands an abort at a random time of every run, and tells whether the servicer stays away for 24 h of free drift.

    python experiments/missions/abort_anytime.py --runs 200 [--seed 1] [--only inspection ...]

A packaged mission without phases is flown as one phase that holds its station.
"""

import argparse
import json
from typing import Any

import numpy as np
from fly_library import Runs, blocks

from rpojax.flight.mission.mission_state import AbortReason
from rpojax.physics.equipment_faults import KINDS
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

AFTER_S = 1200.0
"""Time of the run after the last abort [s], in which its burns are made."""
BURN_S = 120.0
"""From the decision of a burn to its end [s]."""
FAULT_S = 1800.0
"""Duration of the faults of `inspection_faults` and `inspection_abort` [s]."""
LATEST_S = 12000.0
"""Longest run [s]: later aborts of longer missions are like earlier ones."""


def with_abort(name: str) -> ScenarioFile:
    """A packaged mission with an abort at a random time."""
    tables: dict[str, Any] = scenario_loader.load(name).model_dump(exclude_none=True)
    tables["duration_s"] = duration = min(tables["duration_s"], LATEST_S)
    if not tables["phases"]:
        place = tables["formation"]["desired_position_m"]
        tables["phases"] = [{"name": "station", "reference": {"kind": "hold", "position_m": place}}]
    for phase in tables["phases"]:
        # Ends later than the shortened run are never reached.
        for conditions in (phase, phase.get("until", {})):
            for key in {"timeout_s", "time_s"} & set(conditions):
                conditions[key] = min(conditions[key], duration)
    tables["dispersions"] = [each for each in tables["dispersions"] if each.get("key") != "mission.abort_at_s"]
    when = {"key": "mission.abort_at_s", "kind": "uniform", "low": 60.0, "high": duration - AFTER_S}
    tables["dispersions"].append(when)
    last = {"metric": "passive_range_24_h_m", "from_s": duration - 1.0 / tables["rates"]["camera_hz"]}
    tables["requirements"] = [last | {"bound": "at least", "limit": 10.0, "probability": 0.99, "consumer_risk": 0.1}]
    tables["coverage"] = {"enabled": False}
    return scenario_loader.validate(tables)


def _missions_of_one() -> list[str]:
    """Packaged missions of one servicer."""
    return [name for name in scenario_loader.packaged_names() if not scenario_loader.load(name).servicers]


def thruster_is_dead(run: Runs, index: int, at_s: int) -> bool:
    """Whether the thruster gives nothing at a time of a run, or fails within the lead of a burn decided then."""
    if "faults.fault.kind" not in run or KINDS[round(float(run["faults.fault.kind"][index]))] != "thruster_off":
        return False
    start = float(run["faults.fault.start_s"][index])
    return start - BURN_S <= at_s < start + FAULT_S


def main() -> None:
    """Prints one line of JSON per mission."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=_missions_of_one())
    arguments = parser.parse_args()
    for name in arguments.only:
        file = with_abort(name)
        window, done = file.requirements[0].metric_name, 0
        aborted_count, dead_count, unsafe, dead = 0, 0, [], []
        for run in blocks(file, arguments.runs, arguments.seed):
            for index, reasons in enumerate(run["abort_reason"]):
                if not reasons[-1]:
                    continue
                aborted_count += 1
                begin = int(np.argmax(reasons > 0))
                is_dead = thruster_is_dead(run, index, begin)
                dead_count += is_dead
                outside = run["range_m"][index] >= file.limits.keep_out_m
                least = min(run["range_m"][index, begin:].min(), run[window][index])
                if least >= file.limits.keep_out_m and outside[begin]:
                    continue
                spent = float(run["delta_v_m_s"][index, -1] - run["delta_v_m_s"][index, begin])
                (dead if is_dead else unsafe).append(
                    {
                        "run": done + index,
                        "at_s": begin,
                        "reason": AbortReason(int(reasons[-1])).text,
                        "range_m": round(float(run["range_m"][index, begin]), 1),
                        "least_m": round(float(least), 1),
                        "m_s": round(spent, 4),
                    }
                )
            done += len(run["range_m"])
        alive = max(aborted_count - dead_count, 1)
        print(
            json.dumps(
                {
                    "mission": name,
                    "aborts": aborted_count - dead_count,
                    "stay_outside": round(1.0 - len(unsafe) / alive, 4),
                    "exceptions": unsafe[:12],
                    "aborts_with_a_dead_thruster": dead_count,
                    "of_these_not_outside": dead[:12],
                }
            ),
            flush=True,
        )


if __name__ == "__main__":
    main()
