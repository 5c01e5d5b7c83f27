"""Files of a shared folder: whole or absent, never outside of it, and leftovers of dead writers swept away."""

import contextlib
import errno
import functools
import hashlib
import itertools
import json
import os
import re
import socket
import time
from pathlib import Path
from typing import Any

from rpojax.errors import ResultError, UnfinishedError

_COUNTER = itertools.count()
_DISK_FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_MAX_NAME_LENGTH = 100
"""Letters of a name that the name of its partial file holds: systems limit names."""
_STALE_S = 600.0
"""A file takes moments to write: a partial one this old has lost its writer, on whatever machine."""
_PARTIAL = re.compile(r"\.(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-\d+\.partial$")


@functools.cache
def machine_id() -> str:
    """Eight digits that stand for a machine since its start, containers told apart: where process numbers count."""
    parts = [socket.gethostname()]
    for source in (
        Path("/proc/sys/kernel/random/boot_id").read_text,
        lambda: str(Path("/proc/self/ns/pid").readlink()),
    ):
        try:
            parts.append(source())
        except OSError:
            continue
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:8]


def partial_name(name: str) -> str:
    """Name of a file or folder while `name` is being made: hidden, and telling who makes it."""
    return f".{name[:_MAX_NAME_LENGTH]}.{machine_id()}-{os.getpid()}-{next(_COUNTER)}.partial"


def write(path: Path, content: bytes, sync: bool = False) -> None:
    """Writes a file so that a reader sees the old one or the whole new one; `sync`: it also outlasts a power cut.

    Raises:
        UnfinishedError: the disk is full, or the file cannot be written for another reason.
    """
    try:
        write_or_raise(path, content, sync)
    except OSError as error:
        raise write_error(path, error) from None


def write_or_raise(path: Path, content: bytes, sync: bool) -> None:
    """What `write` does; a fault is an `OSError` of whoever calls."""
    partial = path.with_name(partial_name(path.name))
    try:
        with partial.open("xb") as stream:
            stream.write(content)
            stream.flush()
            if sync:
                os.fsync(stream.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    if sync:
        _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Makes a rename in the folder outlast a power cut, where the system can."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_error(path: Path, error: OSError) -> UnfinishedError:
    """What a failed attempt to write means for the campaign."""
    expected = "room for the results" if error.errno in _DISK_FULL_ERRORS else "a file that can be written"
    reason = (error.strerror or str(error)).lower()
    return UnfinishedError(f"{path}: found {reason}, expected {expected}; finished blocks are kept")


def write_json(path: Path, content: Any) -> None:
    """Writes JSON, whole or not at all, and flushed to the disk."""
    write(path, json.dumps(content, indent=2, allow_nan=False).encode() + b"\n", sync=True)


def read_json(path: Path, expected: str, largest: int) -> Any:
    """Content of a JSON file of at most `largest` bytes.

    Raises:
        ResultError: there is none, or it is larger, or no JSON.
    """
    try:
        with path.open("rb") as stream:
            content = stream.read(largest + 1)
        if len(content) > largest:
            raise ResultError(f"{path}: found more than {largest} bytes, expected {expected}")
        return json.loads(content)
    except (OSError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise ResultError(f"{path}: found no readable {path.name} ({reason:.120}), expected {expected}") from None


def check_no_links(root: Path, path: Path) -> None:
    """Refuses a path below `root` that leads elsewhere: a part of it is a symbolic link.

    Raises:
        ResultError: naming the link.
    """
    part = root
    for name in path.relative_to(root).parts:
        part = part / name
        if part.is_symlink() or name == "..":
            raise ResultError(f"{part}: found a link that leads elsewhere, expected a file or folder of the campaign")


def remove_stale_files(folder: Path) -> None:
    """Removes partial files whose writers are gone: dead on this machine, or a long time ago on any."""
    here = machine_id()
    for place, _, names in os.walk(folder):
        for name in names:
            if _PARTIAL.search(name) and _is_stale(Path(place, name), here):
                with contextlib.suppress(OSError):  # one of another user, whose own sweep removes it
                    Path(place, name).unlink()


def _is_stale(path: Path, here: str) -> bool:
    found = _PARTIAL.search(path.name)
    if found and found["machine"] == here and not _is_running(int(found["process"])):
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


def stale_folders(directory: Path) -> list[Path]:
    """Folders that were to become `directory` and lost their makers."""
    here, start = machine_id(), f".{directory.name[:_MAX_NAME_LENGTH]}."
    if not directory.parent.is_dir():
        return []
    found = [path for path in directory.parent.iterdir() if path.name.startswith(start) and path.is_dir()]
    return [path for path in found if _PARTIAL.search(path.name) and not path.is_symlink() and _is_stale(path, here)]
