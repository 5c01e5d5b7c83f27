"""Partial files and folders whose writers were killed, and their removal."""

import contextlib
import os
import re
import time
from pathlib import Path

from rpojax.campaign.storage import atomic_files

_STALE_S = 600.0
"""Age after which a partial file counts as stale on any machine [s]: writing one takes moments."""
_PARTIAL = re.compile(r"\.(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-\d+\.partial$")


def remove_stale_files(folder: Path) -> None:
    """Removes the partial files below a folder whose writers have ended on this machine, or that are old."""
    for place, _, names in os.walk(folder):
        for name in names:
            if _is_stale(Path(place, name)):
                with contextlib.suppress(OSError):  # a file of another user
                    Path(place, name).unlink()


def stale_folders(directory: Path) -> list[Path]:
    """Partial folders that were to become `directory` and whose makers were killed."""
    if not directory.parent.is_dir():
        return []
    start = atomic_files.partial_prefix(directory.name)
    found = [path for path in directory.parent.iterdir() if path.name.startswith(start) and path.is_dir()]
    return [path for path in found if not path.is_symlink() and _is_stale(path)]


def _is_stale(path: Path) -> bool:
    found = _PARTIAL.search(path.name)
    if not found:
        return False
    if found["machine"] == atomic_files.machine_id() and not _is_running(int(found["process"])):
        return True
    try:
        return time.time() - path.lstat().st_mtime > _STALE_S
    except OSError:
        return False


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True
