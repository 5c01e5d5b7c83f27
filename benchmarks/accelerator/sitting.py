"""A sitting: sections one after the other in processes of their own, within a budget of wall-clock time."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import IO, Any

from benchmarks.accelerator.section_list import PLATFORM, Section

MEASURED = "measured"
"""Status of a section with all of its entries."""

OUT_OF_BUDGET = "not measured: budget"
"""Begin of the status of a section that was not begun or not finished for want of time."""

OnEntry = Callable[[dict[str, Any]], None]
RunSection = Callable[[Section, bool, float, OnEntry], str]
"""Runs a section, with small sizes or not, for at most some time [s], and returns its status."""


@dataclass
class Sitting:
    """Results of the sections so far.

    Attributes:
        budget_s: wall-clock time for all sections [s]
        on_change: called with the results after every entry and every section
        run_section: runs one section
        clock: time [s]
        content: the results: platform, and for each section its status, duration and entries
    """

    budget_s: float
    on_change: Callable[[dict[str, Any]], None]
    run_section: RunSection
    clock: Callable[[], float] = time.monotonic
    content: dict[str, Any] = field(default_factory=dict)

    def run(self, sections: Sequence[Section], small: bool) -> dict[str, Any]:
        """Results of all sections; on a CPU, and with `small`, sizes are small.

        A section is left out if less time is left than it takes, and stopped at the end of the budget.
        """
        begin = self.clock()
        self.content.update(budget_s=self.budget_s, elapsed_s=0.0, small=small, platform={}, sections=[])
        status = self.run_section(PLATFORM, small, self.budget_s, self.content["platform"].update)
        small = self.content["small"] = small or self.content["platform"].get("backend") == "cpu"
        if status != MEASURED:
            self.content["platform"]["status"] = status
        for section in sections if status == MEASURED else ():
            record: dict[str, Any] = {"name": section.name, "status": "", "wall_s": 0.0, "entries": []}
            self.content["sections"].append(record)
            left_s = self.budget_s - (self.clock() - begin)
            if left_s < section.expected_s:
                record["status"] = f"{OUT_OF_BUDGET}, {max(left_s, 0.0):.0f} s left of {section.expected_s:.0f} s"
            else:
                self._measure(section, record, small, left_s, begin)
            self._changed(begin)
        return self.content

    def _measure(self, section: Section, record: dict[str, Any], small: bool, left_s: float, begin: float) -> None:
        start = self.clock()

        def add(entry: dict[str, Any]) -> None:
            record["entries"].append(entry)
            record["wall_s"] = self.clock() - start
            self._changed(begin)

        record["status"] = self.run_section(section, small, left_s, add)
        record["wall_s"] = self.clock() - start

    def _changed(self, begin: float) -> None:
        self.content["elapsed_s"] = self.clock() - begin
        self.on_change(self.content)


def run_in_process(section: Section, small: bool, limit_s: float, on_entry: OnEntry) -> str:
    """Status of a section after its process has ended, or was stopped after `limit_s` [s]."""
    words = [sys.executable, "-m", "benchmarks.accelerator.section_process", section.name, *(["--small"] * small)]
    return run_command(words, limit_s, on_entry)


def run_command(words: Sequence[str], limit_s: float, on_entry: OnEntry) -> str:
    """Status of a command that writes entries to its standard output."""
    stopped = threading.Event()
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=errors, text=True, start_new_session=True)
        assert process.stdout is not None

        def stop() -> None:
            stopped.set()
            _end(process)

        timer = threading.Timer(limit_s, stop)
        timer.start()
        try:
            for line in process.stdout:
                if (entry := _entry(line)) is not None:
                    on_entry(entry)
            process.wait()
        finally:
            timer.cancel()
            _end(process)
        if stopped.is_set():
            return f"{OUT_OF_BUDGET}, stopped after {limit_s:.0f} s"
        return MEASURED if process.returncode == 0 else f"failed: {_last_line(errors)}"


def _end(process: "subprocess.Popen[str]") -> None:
    """Ends a process and those that it has started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def _entry(line: str) -> dict[str, Any] | None:
    """Entry of a line; None for other output, such as what a library prints."""
    try:
        message = json.loads(line)
    except ValueError:
        return None
    return message[1] if isinstance(message, list) and message[:1] == ["entry"] else None


def _last_line(errors: IO[bytes]) -> str:
    errors.seek(0)
    lines = errors.read()[-4000:].decode(errors="replace").strip().splitlines()
    return f"{lines[-1]:.300}" if lines else "no message"
