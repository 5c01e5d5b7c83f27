"""A process that simulates missions in Basilisk one after the other, as requested by lines of JSON on standard input.

The first line is a list of the inputs of its runs. It answers `{"import_s": ...}` when it is ready. Every further line,
`{"duration_s": ..., "runs": ...}`, is answered by a list with one entry per run. Answers are lines of standard output.
"""

import time

_BEGIN = time.perf_counter()

import gc  # noqa: E402
import json  # noqa: E402
import os  # noqa: E402
import sys  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

from benchmarks import basilisk_mission  # noqa: E402
from benchmarks.basilisk_mission import SimulatedMission  # noqa: E402

_IMPORT_S = time.perf_counter() - _BEGIN


def summarise(mission: SimulatedMission) -> dict[str, Any]:
    """Figures of a run for the comparison; `last` is its last third."""
    formation, pointing = mission.formation_error_m, mission.pointing_error_deg
    last = slice(-max(len(formation) // 3, 1), None)
    return {
        "setup_s": mission.setup_s,
        "flight_s": mission.flight_s,
        "cpu_s": mission.cpu_s,
        "formation_error_m": float(formation[-1]),
        "formation_error_last_peak_m": float(np.max(formation[last])),
        "pointing_error_deg": float(np.median(pointing)),
        "pointing_error_last_deg": float(np.median(pointing[last])),
        "burn_s": mission.burn_s,
    }


def main() -> None:
    """Answers requests until standard input ends; output of Basilisk itself goes to standard error."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    inputs = [{key: np.array(value) for key, value in run.items()} for run in json.loads(sys.stdin.readline())]
    print(json.dumps({"import_s": _IMPORT_S}), file=answers, flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        results = []
        for number in range(request["runs"]):
            gc.collect()
            mission = basilisk_mission.simulate_mission(inputs[number % len(inputs)], request["duration_s"], number)
            results.append(summarise(mission))
        print(json.dumps(results), file=answers, flush=True)


if __name__ == "__main__":
    main()
