"""Executor that simulates blocks in worker processes of this machine, each with its own part of the cores."""

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import IO, Any

from rpojax.campaign.execution.executor import MAX_ATTEMPTS, ExecutorProgressCallback, check_default_stages
from rpojax.campaign.execution.worker_process import ALLOW_PLUGIN
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError, UnfinishedError
from rpojax.runtime import jax_environment

WORKER = "rpojax.campaign.execution.worker_process"


@dataclass(frozen=True)
class ProcessExecutor:
    """Distributes batches of blocks to worker processes and replaces those that die.

    Attributes:
        campaign: where results are stored
        workers: number of processes
    """

    campaign: Campaign
    workers: int

    def run_blocks(self, blocks: Sequence[int], on_progress: ExecutorProgressCallback) -> dict[int, str]:
        """Simulates some blocks; those of a worker that dies are repeated, up to `MAX_ATTEMPTS` times."""
        check_default_stages(self.campaign)
        options = [ALLOW_PLUGIN] if self.campaign.file.plugin else []
        parts = split_cores(sorted(_available_cores()), min(self.workers, len(blocks)))
        size = max(1, min(len(parts[0]), -(-len(blocks) // len(parts))))
        batches = deque(list(blocks[first : first + size]) for first in range(0, len(blocks), size))
        queue = _BatchQueue(batches, self.campaign.configuration, on_progress)
        on_progress(0.0, 0, False)
        threads = [
            threading.Thread(
                target=_supervise_worker,
                args=(slot, cores[:size], cores, [str(self.campaign.directory), *options], queue),
                daemon=True,
            )
            for slot, cores in enumerate(parts)
        ]
        for place, thread in enumerate(threads):
            if place > 0:
                # The first worker fills the compile cache, from which the others load their programs.
                while not queue.ready.wait(0.2) and threads[0].is_alive():
                    pass
            thread.start()
        for thread in threads:
            thread.join()
        if queue.error is not None:
            raise queue.error
        return queue.failed_blocks


def split_cores(cores: Sequence[int], workers: int) -> list[list[int]]:
    """Cores of each worker: parts of nearly equal size, or one core each in turn if there are more workers."""
    if workers >= len(cores):
        return [[cores[slot % len(cores)]] for slot in range(workers)]
    return [list(cores[slot::workers]) for slot in range(workers)]


def _available_cores() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


@dataclass
class _BatchQueue:
    """Batches of blocks and their progress, shared by the threads that supervise the workers.

    Attributes:
        pending: batches to be simulated
        configuration: of the campaign
        on_progress: called after every change
        lock: held while a field is read or changed
        ready: set once the first worker has compiled its programs
        attempts: block -> workers that died while simulating it
        failed_blocks: block given up -> reason
        in_progress: slot of a worker -> runs done of its batch, fractions included, and runs failed
        done: runs of finished batches
        failed: those of them that failed
        error: that ends the campaign
    """

    pending: deque[list[int]]
    configuration: CampaignConfiguration
    on_progress: ExecutorProgressCallback
    lock: threading.Lock = field(default_factory=threading.Lock)
    ready: threading.Event = field(default_factory=threading.Event)
    attempts: dict[int, int] = field(default_factory=dict)
    failed_blocks: dict[int, str] = field(default_factory=dict)
    in_progress: dict[int, tuple[float, int]] = field(default_factory=dict)
    done: int = 0
    failed: int = 0
    error: RpojaxError | None = None

    def next_batch(self) -> list[int] | None:
        """Takes the next batch; None if none is left, or after an error."""
        with self.lock:
            return self.pending.popleft() if self.pending and self.error is None else None

    def record_progress(self, slot: int, fraction: float, failed: int, batch: Sequence[int]) -> None:
        """Notes the finished fraction of a worker's batch."""
        with self.lock:
            self.in_progress[slot] = (fraction * self._run_count(batch), failed)
            self._report_progress()

    def record_done(self, slot: int, failed: int, batch: Sequence[int]) -> None:
        """Notes that a worker has finished its batch."""
        with self.lock:
            self.in_progress.pop(slot, None)
            self.done += self._run_count(batch)
            self.failed += failed
            self._report_progress()

    def requeue(self, slot: int, batch: Sequence[int], reason: str) -> None:
        """Queues the blocks of a worker that died one by one, so that a bad block affects no other."""
        with self.lock:
            self.in_progress.pop(slot, None)
            for block in batch:
                self.attempts[block] = self.attempts.get(block, 0) + 1
                if self.attempts[block] >= MAX_ATTEMPTS:
                    self.failed_blocks[block] = reason
                else:
                    self.pending.append([block])

    def _run_count(self, batch: Sequence[int]) -> int:
        return sum(self.configuration.runs_in_block(block) for block in batch)

    def _report_progress(self) -> None:
        running = self.in_progress.values()
        done = self.done + sum(done for done, _ in running)
        self.on_progress(done, self.failed + sum(failed for _, failed in running), True)


def _supervise_worker(
    slot: int, devices: Sequence[int], cores: Sequence[int], place: Sequence[str], queue: _BatchQueue
) -> None:
    """Runs workers one after the other, each until it dies, while there are batches."""
    while (batch := queue.next_batch()) is not None:
        try:
            _run_worker(slot, devices, cores, place, batch, queue)
        except OSError as error:  # no room for another process, or for its standard error
            queue.requeue(slot, batch, f"no worker could be started: {error.strerror or error}")


def _run_worker(
    slot: int, devices: Sequence[int], cores: Sequence[int], place: Sequence[str], first: list[int], queue: _BatchQueue
) -> None:
    """Has a worker simulate batches from a first one on, until there are no more or it dies."""
    batch: list[int] | None = first
    with tempfile.TemporaryFile() as errors:
        process = _start_worker(place, len(devices), cores, errors)
        try:
            while batch is not None and _execute_batch(slot, process, batch, queue):
                batch = queue.next_batch()
        except OSError:
            pass  # it died while its input was written
        finally:
            process.kill()
            process.wait()
        if batch is not None and queue.error is None:
            queue.requeue(slot, batch, _exit_reason(process.returncode, errors))


def _start_worker(
    place: Sequence[str], devices: int, cores: Sequence[int], errors: IO[bytes]
) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", WORKER, place[0], ",".join(map(str, cores)), *place[1:]],
        env=jax_environment.environment_with_devices(devices),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
        text=True,
    )


def _execute_batch(slot: int, process: "subprocess.Popen[str]", batch: Sequence[int], queue: _BatchQueue) -> bool:
    """Whether the worker simulated a batch of blocks; false if it died or reported an error."""
    assert process.stdin
    assert process.stdout
    process.stdin.write(json.dumps(list(batch)) + "\n")
    process.stdin.flush()
    for line in process.stdout:
        kind, *rest = _parse_message(line)
        if kind == "ready":
            queue.ready.set()
            queue.record_progress(slot, 0.0, 0, batch)
        elif kind == "progress":
            queue.record_progress(slot, rest[0], rest[1], batch)
        elif kind == "done":
            queue.record_done(slot, rest[0], batch)
            return True
        elif kind == "error":
            queue.error = UnfinishedError(rest[1]) if rest[0] == "UnfinishedError" else RpojaxError(rest[1])
            return False
    return False


def _parse_message(line: str) -> list[Any]:
    """Message of a worker; other output, such as a print of a library, has an empty kind."""
    try:
        message = json.loads(line)
    except ValueError:
        return [""]
    return message if isinstance(message, list) and message else [""]


def _exit_reason(status: int, errors: IO[bytes]) -> str:
    """Exit status or signal of a worker that died, and the last line of its standard error."""
    errors.seek(0)
    lines = errors.read()[-4000:].decode(errors="replace").strip().splitlines()
    ended = f"signal {-status}" if status < 0 else f"status {status}"
    return f"the worker ended with {ended}" + (f": {lines[-1]:.200}" if lines else "")
