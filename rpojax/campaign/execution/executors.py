"""Who does the blocks of a campaign: this process, some processes of this machine, or a cluster.

A block is a function of the campaign's folder and its number, and its results go into the folder and nowhere else. So
an executor only hands out numbers, sees who dies, and has the block done again.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import IO, Any, Protocol, runtime_checkable

from rpojax.campaign.execution import block_runner
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.storage import campaign_json
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError, UnfinishedError

MAX_ATTEMPTS = 3
"""A block that so many workers died of is given up."""

ExecutorProgressCallback = Callable[[float, int, bool], None]
"""Told the run-equivalents done, the runs failed so far, and whether programs are compiled."""


@runtime_checkable
class Executor(Protocol):
    """Does blocks of one campaign."""

    def run_blocks(self, blocks: Sequence[int], on_progress: ExecutorProgressCallback) -> dict[int, str]:
        """Does some blocks, into the campaign's folder; returns those given up, each with the reason.

        Raises:
            RpojaxError: nobody could do them, as when the disk is full.
        """
        ...


@dataclass(frozen=True)
class LocalExecutor:
    """All devices of this process."""

    campaign: Campaign
    engine: BatchEngine

    def run_blocks(self, blocks: Sequence[int], on_progress: ExecutorProgressCallback) -> dict[int, str]:
        """Does some blocks, as many at once as there are devices; an error ends the process, so none is given up.

        While blocks are flown those before them are stored, by a thread.
        """
        on_progress(0.0, 0, False)
        self.engine.compile()
        on_progress(0.0, 0, True)
        done, failed = 0, 0
        with ThreadPoolExecutor(1) as pool:
            storing: Future[None] | None = None
            for first in range(0, len(blocks), len(self.engine.devices)):
                wave = blocks[first : first + len(self.engine.devices)]
                runs = sum(campaign_json.runs_in_block(self.campaign.configuration, block) for block in wave)
                landed = block_runner.simulate_blocks(
                    self.campaign, self.engine, wave, _batch_progress(on_progress, runs, done, failed)
                )
                if storing is not None:
                    storing.result()
                storing = pool.submit(block_runner.store_blocks, self.campaign, self.engine, landed)
                done, failed = done + runs, failed + landed.failed_runs
            if storing is not None:
                storing.result()
        return {}


def _batch_progress(
    tell: ExecutorProgressCallback, runs: int, done: int, failed: int
) -> block_runner.BatchProgressCallback:
    """Tells how far a wave of `runs` is, after those done and failed before it."""
    return lambda share, failures: tell(done + share * runs, failed + failures, True)


def check_default_stages(campaign: Campaign) -> None:
    """Refuses replaced stages, which other processes cannot be told of.

    Raises:
        RpojaxError: a stage of the campaign is replaced.
    """
    if stages := campaign.configuration["stages"]:
        raise RpojaxError(f"stages: found {sorted(stages)} replaced, expected none with other processes as workers")


@dataclass
class _WorkQueue:
    """What the threads of some workers share."""

    pending: deque[list[int]]
    configuration: dict[str, Any]
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
        with self.lock:
            return self.pending.popleft() if self.pending and self.error is None else None

    def record_progress(self, slot: int, share: float, failed: int, wave: Sequence[int]) -> None:
        with self.lock:
            self.in_progress[slot] = (share * self._run_count(wave), failed)
            self._report_progress()

    def record_done(self, slot: int, failed: int, wave: Sequence[int]) -> None:
        with self.lock:
            self.in_progress.pop(slot, None)
            self.done += self._run_count(wave)
            self.failed += failed
            self._report_progress()

    def requeue(self, slot: int, wave: Sequence[int], reason: str) -> None:
        """A worker has died of a wave: its blocks are tried again one by one, so that a bad one loses no other."""
        with self.lock:
            self.in_progress.pop(slot, None)
            for block in wave:
                self.attempts[block] = self.attempts.get(block, 0) + 1
                if self.attempts[block] >= MAX_ATTEMPTS:
                    self.failed_blocks[block] = reason
                else:
                    self.pending.append([block])

    def _run_count(self, wave: Sequence[int]) -> int:
        return sum(campaign_json.runs_in_block(self.configuration, block) for block in wave)

    def _report_progress(self) -> None:
        shares = self.in_progress.values()
        self.on_progress(self.done + sum(done for done, _ in shares), self.failed + sum(bad for _, bad in shares), True)


@dataclass(frozen=True)
class ProcessExecutor:
    """Some processes of this machine, each with its own part of the cores."""

    campaign: Campaign
    workers: int

    def run_blocks(self, blocks: Sequence[int], on_progress: ExecutorProgressCallback) -> dict[int, str]:
        """Does some blocks; the ones of a worker that dies are done by another, up to `MOST_ATTEMPTS` times."""
        check_default_stages(self.campaign)
        parts = split_cores(sorted(_available_cores()), min(self.workers, len(blocks)))
        size = max(1, min(len(parts[0]), -(-len(blocks) // len(parts))))
        waves = deque(list(blocks[first : first + size]) for first in range(0, len(blocks), size))
        work = _WorkQueue(waves, self.campaign.configuration, on_progress)
        on_progress(0.0, 0, False)
        threads = [
            threading.Thread(
                target=_supervise_worker,
                args=(slot, cores[:size], cores, str(self.campaign.directory), work),
                daemon=True,
            )
            for slot, cores in enumerate(parts)
        ]
        for place, thread in enumerate(threads):
            if place > 0:
                # The first one compiles for all: the others find the programs in the cache.
                while not work.ready.wait(0.2) and threads[0].is_alive():
                    pass
            thread.start()
        for thread in threads:
            thread.join()
        if work.error is not None:
            raise work.error
        return work.failed_blocks


def split_cores(cores: Sequence[int], workers: int) -> list[list[int]]:
    """Cores of each worker: parts as equal as can be, or one core each in turn where there are more workers."""
    if workers >= len(cores):
        return [[cores[slot % len(cores)]] for slot in range(workers)]
    return [list(cores[slot::workers]) for slot in range(workers)]


def _available_cores() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def _supervise_worker(
    slot: int, devices: Sequence[int], cores: Sequence[int], directory: str, work: _WorkQueue
) -> None:
    """Keeps a worker busy, and puts another into the place of one that died."""
    while (wave := work.next_batch()) is not None:
        try:
            _run_worker(slot, devices, cores, directory, wave, work)
        except OSError as error:  # there is no room for another process, or for what it says
            work.requeue(slot, wave, f"no worker could be started: {error.strerror or error}")


def _run_worker(
    slot: int, devices: Sequence[int], cores: Sequence[int], directory: str, first: list[int], work: _WorkQueue
) -> None:
    """Has a worker do waves from a first one on, until there are no more or it dies."""
    wave: list[int] | None = first
    with tempfile.TemporaryFile() as errors:
        process = _start_worker(directory, len(devices), cores, errors)
        try:
            while wave is not None and _execute_batch(slot, process, wave, work):
                wave = work.next_batch()
        except OSError:
            pass  # it died while it was written to
        finally:
            process.kill()
            process.wait()
        if wave is not None and work.error is None:
            work.requeue(slot, wave, _exit_reason(process.returncode, errors))


def _start_worker(directory: str, devices: int, cores: Sequence[int], errors: IO[bytes]) -> "subprocess.Popen[str]":
    flags = re.sub(r"--xla_force_host_platform_device_count=\S*", "", os.environ.get("XLA_FLAGS", ""))
    flags = f"{flags} --xla_force_host_platform_device_count={devices}".strip()
    return subprocess.Popen(
        [sys.executable, "-m", "rpojax.campaign.execution.worker_process", directory, ",".join(map(str, cores))],
        env={**os.environ, "XLA_FLAGS": flags},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
        text=True,
    )


def _execute_batch(slot: int, process: "subprocess.Popen[str]", wave: Sequence[int], work: _WorkQueue) -> bool:
    """Whether the worker did a wave of blocks; false if it died or said that it cannot."""
    assert process.stdin
    assert process.stdout
    process.stdin.write(json.dumps(list(wave)) + "\n")
    process.stdin.flush()
    for line in process.stdout:
        word, *rest = _parse_message(line)
        if word == "ready":
            work.ready.set()
            work.record_progress(slot, 0.0, 0, wave)
        elif word == "during":
            work.record_progress(slot, rest[0], rest[1], wave)
        elif word == "done":
            work.record_done(slot, rest[0], wave)
            return True
        elif word == "error":
            work.error = UnfinishedError(rest[1]) if rest[0] == "UnfinishedError" else RpojaxError(rest[1])
            return False
    return False


def _parse_message(line: str) -> list[Any]:
    """What a worker says; a line that is not for this process, such as one that a library prints, says nothing."""
    try:
        words = json.loads(line)
    except ValueError:
        return [""]
    return words if isinstance(words, list) and words else [""]


def _exit_reason(status: int, errors: IO[bytes]) -> str:
    """Why a worker died, as far as it can be known."""
    errors.seek(0)
    lines = errors.read()[-4000:].decode(errors="replace").strip().splitlines()
    ended = f"signal {-status}" if status < 0 else f"status {status}"
    return f"the worker ended with {ended}" + (f": {lines[-1]:.200}" if lines else "")
