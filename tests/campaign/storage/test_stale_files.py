"""Removal of the partial files of killed writers."""

import os
import subprocess
import sys
import time
from pathlib import Path

from rpojax.campaign.storage import atomic_files, folder_creation


def ended_process() -> int:
    """Number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_only_partial_files_of_ended_writers_are_removed(tmp_path: Path) -> None:
    here, other, ended = atomic_files.machine_id(), "0" * 8, ended_process()
    names = {
        "ended process": f".a.{here}-{ended}-0.partial",
        "running process": f".b.{here}-{os.getpid()}-0.partial",
        "other machine": f".c.{other}-{ended}-0.partial",
        "other machine, old": f".d.{other}-1-0.partial",
        "other tool, old": "e.partial",
        "no partial file": "f",
    }
    folder = tmp_path / "deep" / "down"
    folder.mkdir(parents=True)
    for name in names.values():
        (folder / name).touch()
    for name in ("other machine, old", "other tool, old", "no partial file"):
        os.utime(folder / names[name], times=(time.time() - 3600.0,) * 2)
    folder_creation.remove_stale_files(tmp_path)
    left = {name for name, file in names.items() if (folder / file).exists()}
    assert left == {"running process", "other machine", "other tool, old", "no partial file"}
