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
from rpojax.campaign.execution.batch_engine import Engine
from rpojax.campaign.storage import campaign_json
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError, UnfinishedError

MOST_ATTEMPTS = 3
"""A block that so many workers died of is given up."""

Tell = Callable[[float, int, bool], None]
"""Told the run-equivalents done, the runs failed so far, and whether programs are compiled."""


@runtime_checkable
class Executor(Protocol):
    """Does blocks of one campaign."""

    def do(self, blocks: Sequence[int], tell: Tell) -> dict[int, str]:
        """Does some blocks, into the campaign's folder; returns those given up, each with the reason.

        Raises:
            RpojaxError: nobody could do them, as when the disk is full.
        """
        ...


@dataclass(frozen=True)
class Local:
    """All devices of this process."""

    result: Campaign
    engine: Engine

    def do(self, blocks: Sequence[int], tell: Tell) -> dict[int, str]:
        """Does some blocks, as many at once as there are devices; an error ends the process, so none is given up.

        While blocks are flown those before them are stored, by a thread.
        """
        tell(0.0, 0, False)
        self.engine.compile()
        tell(0.0, 0, True)
        done, failed = 0, 0
        with ThreadPoolExecutor(1) as pool:
            storing: Future[None] | None = None
            for first in range(0, len(blocks), len(self.engine.devices)):
                wave = blocks[first : first + len(self.engine.devices)]
                runs = sum(campaign_json.count(self.result.asked, block) for block in wave)
                landed = block_runner.fly_blocks(self.result, self.engine, wave, _during(tell, runs, done, failed))
                if storing is not None:
                    storing.result()
                storing = pool.submit(block_runner.store_blocks, self.result, self.engine, landed)
                done, failed = done + runs, failed + landed.failures
            if storing is not None:
                storing.result()
        return {}


def _during(tell: Tell, runs: int, done: int, failed: int) -> block_runner.During:
    """Tells how far a wave of `runs` is, after those done and failed before it."""
    return lambda share, failures: tell(done + share * runs, failed + failures, True)


def check_stages(result: Campaign) -> None:
    """Refuses replaced stages, which other processes cannot be told of.

    Raises:
        RpojaxError: a stage of the campaign is replaced.
    """
    if stages := result.asked["stages"]:
        raise RpojaxError(f"stages: found {sorted(stages)} replaced, expected none with other processes as workers")


@dataclass
class _Work:
    """What the threads of some workers share."""

    pending: deque[list[int]]
    asked: dict[str, Any]
    tell: Tell
    lock: threading.Lock = field(default_factory=threading.Lock)
    ready: threading.Event = field(default_factory=threading.Event)
    attempts: dict[int, int] = field(default_factory=dict)
    given_up: dict[int, str] = field(default_factory=dict)
    under_way: dict[int, tuple[float, int]] = field(default_factory=dict)
    done: int = 0
    failed: int = 0
    error: RpojaxError | None = None

    def next(self) -> list[int] | None:
        with self.lock:
            return self.pending.popleft() if self.pending and self.error is None else None

    def note(self, slot: int, share: float, failed: int, wave: Sequence[int]) -> None:
        with self.lock:
            self.under_way[slot] = (share * self._runs(wave), failed)
            self._tell()

    def finish(self, slot: int, failed: int, wave: Sequence[int]) -> None:
        with self.lock:
            self.under_way.pop(slot, None)
            self.done += self._runs(wave)
            self.failed += failed
            self._tell()

    def lose(self, slot: int, wave: Sequence[int], reason: str) -> None:
        """A worker has died of a wave: its blocks are tried again one by one, so that a bad one loses no other."""
        with self.lock:
            self.under_way.pop(slot, None)
            for block in wave:
                self.attempts[block] = self.attempts.get(block, 0) + 1
                if self.attempts[block] >= MOST_ATTEMPTS:
                    self.given_up[block] = reason
                else:
                    self.pending.append([block])

    def _runs(self, wave: Sequence[int]) -> int:
        return sum(campaign_json.count(self.asked, block) for block in wave)

    def _tell(self) -> None:
        shares = self.under_way.values()
        self.tell(self.done + sum(done for done, _ in shares), self.failed + sum(bad for _, bad in shares), True)


@dataclass(frozen=True)
class Workers:
    """Some processes of this machine, each with its own part of the cores."""

    result: Campaign
    count: int

    def do(self, blocks: Sequence[int], tell: Tell) -> dict[int, str]:
        """Does some blocks; the ones of a worker that dies are done by another, up to `MOST_ATTEMPTS` times."""
        check_stages(self.result)
        parts = shares(sorted(_cores()), min(self.count, len(blocks)))
        size = max(1, min(len(parts[0]), -(-len(blocks) // len(parts))))
        waves = deque(list(blocks[first : first + size]) for first in range(0, len(blocks), size))
        work = _Work(waves, self.result.asked, tell)
        tell(0.0, 0, False)
        threads = [
            threading.Thread(
                target=_tend, args=(slot, cores[:size], cores, str(self.result.directory), work), daemon=True
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
        return work.given_up


def shares(cores: Sequence[int], workers: int) -> list[list[int]]:
    """Cores of each worker: parts as equal as can be, or one core each in turn where there are more workers."""
    if workers >= len(cores):
        return [[cores[slot % len(cores)]] for slot in range(workers)]
    return [list(cores[slot::workers]) for slot in range(workers)]


def _cores() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def _tend(slot: int, devices: Sequence[int], cores: Sequence[int], directory: str, work: _Work) -> None:
    """Keeps a worker busy, and puts another into the place of one that died."""
    while (wave := work.next()) is not None:
        try:
            _employ(slot, devices, cores, directory, wave, work)
        except OSError as error:  # there is no room for another process, or for what it says
            work.lose(slot, wave, f"no worker could be started: {error.strerror or error}")


def _employ(
    slot: int, devices: Sequence[int], cores: Sequence[int], directory: str, first: list[int], work: _Work
) -> None:
    """Has a worker do waves from a first one on, until there are no more or it dies."""
    wave: list[int] | None = first
    with tempfile.TemporaryFile() as errors:
        process = _start(directory, len(devices), cores, errors)
        try:
            while wave is not None and _converse(slot, process, wave, work):
                wave = work.next()
        except OSError:
            pass  # it died while it was written to
        finally:
            process.kill()
            process.wait()
        if wave is not None and work.error is None:
            work.lose(slot, wave, _last_words(process.returncode, errors))


def _start(directory: str, devices: int, cores: Sequence[int], errors: IO[bytes]) -> "subprocess.Popen[str]":
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


def _converse(slot: int, process: "subprocess.Popen[str]", wave: Sequence[int], work: _Work) -> bool:
    """Whether the worker did a wave of blocks; false if it died or said that it cannot."""
    assert process.stdin
    assert process.stdout
    process.stdin.write(json.dumps(list(wave)) + "\n")
    process.stdin.flush()
    for line in process.stdout:
        word, *rest = _words(line)
        if word == "ready":
            work.ready.set()
            work.note(slot, 0.0, 0, wave)
        elif word == "during":
            work.note(slot, rest[0], rest[1], wave)
        elif word == "done":
            work.finish(slot, rest[0], wave)
            return True
        elif word == "error":
            work.error = UnfinishedError(rest[1]) if rest[0] == "UnfinishedError" else RpojaxError(rest[1])
            return False
    return False


def _words(line: str) -> list[Any]:
    """What a worker says; a line that is not for this process, such as one that a library prints, says nothing."""
    try:
        words = json.loads(line)
    except ValueError:
        return [""]
    return words if isinstance(words, list) and words else [""]


def _last_words(status: int, errors: IO[bytes]) -> str:
    """Why a worker died, as far as it can be known."""
    errors.seek(0)
    lines = errors.read()[-4000:].decode(errors="replace").strip().splitlines()
    ended = f"signal {-status}" if status < 0 else f"status {status}"
    return f"the worker ended with {ended}" + (f": {lines[-1]:.200}" if lines else "")
