"""Processes of `basilisk_worker`, one per core, that get the same requests at the same time."""

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.speed_comparison import MissionCheck, TimedPass
from rpojax.errors import RpojaxError

_ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class BasiliskWorkers:
    """Worker processes of Basilisk, ready to simulate.

    Attributes:
        workers: one process per core
        import_s: time that the slowest process took for its imports [s]
    """

    workers: list["subprocess.Popen[str]"]
    import_s: float

    def check_mission(self, duration_s: float, orbits: int) -> list[MissionCheck]:
        """One run per core over some orbits, `duration_s` in all; also warms the processes up."""
        results = self._request(1, duration_s)
        return [
            MissionCheck(orbits, run["formation_error_last_peak_m"], run["pointing_error_last_deg"], run["burn_s"])
            for (run,) in results
        ]

    def run_pass(self, runs: int, duration_s: float) -> TimedPass:
        """Timing of `runs` runs on each core, one after the other."""
        results = self._request(runs, duration_s)
        all_runs = [run for core in results for run in core]
        simulated_s = runs * duration_s
        return TimedPass(
            simulator="Basilisk",
            at_once=len(results),
            runs=len(all_runs),
            duration_s=duration_s,
            flight_rate=sum(simulated_s / sum(run["flight_s"] for run in core) for core in results),
            whole_rate=sum(simulated_s / sum(run["setup_s"] + run["flight_s"] for run in core) for core in results),
            cpu_s=sum(run["cpu_s"] for run in all_runs),
            setup_s=float(np.mean([run["setup_s"] for run in all_runs])),
            formation_error_m=float(np.median([run["formation_error_m"] for run in all_runs])),
            pointing_error_deg=float(np.median([run["pointing_error_deg"] for run in all_runs])),
        )

    def _request(self, runs: int, duration_s: float) -> list[list[dict[str, Any]]]:
        for worker in self.workers:
            _send(worker, {"runs": runs, "duration_s": duration_s})
        return [_receive(worker) for worker in self.workers]


@contextmanager
def started_workers(inputs: Sequence[dict[str, Any]], cores: int) -> Iterator[BasiliskWorkers]:
    """Context with processes that have imported Basilisk and received their part of the runs."""
    command = [sys.executable, "-m", "benchmarks.basilisk_worker"]
    workers: list[subprocess.Popen[str]] = []
    try:
        for core in range(cores):
            workers.append(_start(command))
            _send(workers[-1], list(inputs[core::cores]))
        yield BasiliskWorkers(workers, max(_receive(worker)["import_s"] for worker in workers))
    finally:
        for worker in workers:
            worker.kill()
            worker.communicate()


def _start(command: list[str]) -> "subprocess.Popen[str]":
    """Starts a process in a session of its own, so that an interrupt reaches only the parent."""
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=_ROOT, stdin=pipe, stdout=pipe, text=True, start_new_session=True)


def _send(worker: "subprocess.Popen[str]", content: Any) -> None:
    assert worker.stdin is not None
    try:
        print(json.dumps(content), file=worker.stdin, flush=True)
    except BrokenPipeError:
        raise _unexpected_end(worker) from None


def _receive(worker: "subprocess.Popen[str]") -> Any:
    assert worker.stdout is not None
    line = worker.stdout.readline()
    if not line:
        raise _unexpected_end(worker)
    return json.loads(line)


def _unexpected_end(worker: "subprocess.Popen[str]") -> RpojaxError:
    return RpojaxError(f"Basilisk: found a process that ended with exit status {worker.wait()}, expected its answer")
