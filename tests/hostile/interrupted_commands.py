"""Commands in processes of their own, with signals at chosen stages."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import rpojax

SHORT = ("--set", "duration_s=200")
STAGES = {
    "start of Python": 0.02,
    "import": 0.12,
    "reading and drawing": 0.6,
    "compiling": "compiling",
    "simulating": "simulating",
    "storing": "manifest",
    "reporting": "writing the report",
}
"""Stage -> seconds after the start, or the text that stderr shows when it begins."""


@dataclass(frozen=True)
class Ended:
    """How a command ended: status of a shell, streams, seconds from the signal to the end."""

    status: int
    out: str
    err: str
    wait_s: float


def command(*words: str, stdout: int | None = subprocess.PIPE, **environment: str | None) -> subprocess.Popen[str]:
    """A command that begins, with variables changed, or removed where they are None."""
    # A job in the background ignores SIGINT, and so would its children.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    own = {name: value for name, value in os.environ.items() if not name.startswith(("XLA_", "JAX_"))}
    own["PYTHONPATH"] = str(Path(rpojax.__file__).parents[1])
    changed = {name: value for name, value in {**own, **environment}.items() if value is not None}
    return subprocess.Popen(
        [sys.executable, "-m", "rpojax", *words], env=changed, stdout=stdout, stderr=subprocess.PIPE, text=True
    )


def ended(process: subprocess.Popen[str], since: float | None = None) -> Ended:
    """Waits for the end of a command."""
    out, err = process.communicate(timeout=300)
    status = process.returncode if process.returncode >= 0 else 128 - process.returncode
    return Ended(status, out or "", err, 0.0 if since is None else time.monotonic() - since)


def run_to_end(*words: str, **environment: str | None) -> Ended:
    """Runs a command to its end."""
    return ended(command(*words, **environment))


def signalled(stage: str, number: signal.Signals, words: Sequence[str], folder: Path) -> Ended:
    """Runs a command and sends it a signal when a stage begins."""
    process = command(*words)
    trigger = STAGES[stage]
    lines: list[str] = []
    found = threading.Event()

    def watch() -> None:
        assert process.stderr is not None
        for line in process.stderr:
            lines.append(line)
            if isinstance(trigger, str) and trigger in line:
                found.set()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    if isinstance(trigger, float):
        time.sleep(trigger)
    elif trigger == "manifest":
        while process.poll() is None and not (folder / "results.zarr").exists():
            time.sleep(0.002)
    else:
        found.wait(240)
        time.sleep(0.3 if stage == "reporting" else 0.05)
    process.send_signal(number)
    since = time.monotonic()
    process.wait(timeout=120)
    waited = time.monotonic() - since
    watcher.join()
    out = process.stdout.read() if process.stdout is not None else ""
    status = process.returncode if process.returncode >= 0 else 128 - process.returncode
    return Ended(status, out, "".join(lines), waited)
