"""Processes of `basilisk_worker`, one per core, given the same orders at the same time."""

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
    """Basilisk, ready to fly.

    Attributes:
        workers: one process per core
        import_s: the slowest process took to import what it needs [s]
    """

    workers: list["subprocess.Popen[str]"]
    import_s: float

    def check_mission(self, duration_s: float, orbits: int) -> list[MissionCheck]:
        """A run on each core over some orbits, of `duration_s` together; also warms the processes up."""
        flown = self._request(1, duration_s)
        return [
            MissionCheck(orbits, run["formation_error_last_peak_m"], run["pointing_error_last_deg"], run["burn_s"])
            for (run,) in flown
        ]

    def run_pass(self, runs: int, duration_s: float) -> TimedPass:
        """Some runs one after the other on each core."""
        flown = self._request(runs, duration_s)
        every = [run for one in flown for run in one]
        return TimedPass(
            simulator="Basilisk",
            at_once=len(flown),
            runs=len(every),
            duration_s=duration_s,
            flight_rate=sum(runs * duration_s / sum(run["flight_s"] for run in one) for one in flown),
            whole_rate=sum(runs * duration_s / sum(run["setup_s"] + run["flight_s"] for run in one) for one in flown),
            cpu_s=sum(run["cpu_s"] for run in every),
            setup_s=float(np.mean([run["setup_s"] for run in every])),
            formation_error_m=float(np.median([run["formation_error_m"] for run in every])),
            pointing_error_deg=float(np.median([run["pointing_error_deg"] for run in every])),
        )

    def _request(self, runs: int, duration_s: float) -> list[list[dict[str, Any]]]:
        for worker in self.workers:
            _send(worker, {"runs": runs, "duration_s": duration_s})
        return [_receive(worker) for worker in self.workers]


@contextmanager
def started_workers(inputs: Sequence[dict[str, Any]], cores: int) -> Iterator[BasiliskWorkers]:
    """Processes that have imported Basilisk and have their share of the runs; they end with the context."""
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
    """A process of its own session: an interrupt is for the one that gives the orders."""
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
