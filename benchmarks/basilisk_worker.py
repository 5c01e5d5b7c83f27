"""A process that flies missions of Basilisk one after the other, as told by lines of JSON on stdin.

First line: a list of the inputs of its runs. It answers `{"import_s": ...}` when it can begin. Every further line,
`{"duration_s": ..., "runs": ...}`, is answered by a list with one entry per run. Answers go to stdout, one line each.
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


def summary(flight: SimulatedMission) -> dict[str, Any]:
    """What the comparison wants to know of a run; `last` is the last third of it."""
    formation, pointing = flight.formation_error_m, flight.pointing_error_deg
    last = slice(-max(len(formation) // 3, 1), None)
    return {
        "setup_s": flight.setup_s,
        "flight_s": flight.flight_s,
        "cpu_s": flight.cpu_s,
        "formation_error_m": float(formation[-1]),
        "formation_error_last_peak_m": float(np.max(formation[last])),
        "pointing_error_deg": float(np.median(pointing)),
        "pointing_error_last_deg": float(np.median(pointing[last])),
        "burn_s": flight.burn_s,
    }


def main() -> None:
    """Answers until stdin ends; what Basilisk itself prints goes to stderr."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    inputs = [{key: np.array(value) for key, value in run.items()} for run in json.loads(sys.stdin.readline())]
    print(json.dumps({"import_s": _IMPORT_S}), file=answers, flush=True)
    for line in sys.stdin:
        order = json.loads(line)
        results = []
        for number in range(order["runs"]):
            gc.collect()
            results.append(
                summary(basilisk_mission.simulate_mission(inputs[number % len(inputs)], order["duration_s"], number))
            )
        print(json.dumps(results), file=answers, flush=True)


if __name__ == "__main__":
    main()
