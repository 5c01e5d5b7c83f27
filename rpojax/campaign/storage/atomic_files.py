"""Atomic writing of files: a reader sees the old file or the whole new one; a killed writer leaves a partial file."""

import errno
import functools
import hashlib
import itertools
import json
import os
import socket
from collections import deque
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any

from rpojax.errors import ResultError, UnfinishedError
from rpojax.runtime.thread_pools import thread_pool
from rpojax.untrusted import json_reading
from rpojax.untrusted.file_reading import FileError, FileKind
from rpojax.untrusted.structure_limits import StructureError

_COUNTER = itertools.count()
_DISK_FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_FLUSHED_AT_ONCE = 16
_MAX_NAME_LENGTH = 100
"""Letters of a file's name that the name of its partial file repeats: systems limit the length of names."""


@functools.cache
def machine_id() -> str:
    """Eight hexadecimal digits for a machine since its start, or for a container: the scope of process numbers."""
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
    """Hidden name of a file or folder while `name` is being made, with the machine and process that make it."""
    return f"{partial_prefix(name)}{machine_id()}-{os.getpid()}-{next(_COUNTER)}.partial"


def partial_prefix(name: str) -> str:
    """First part of the partial names of `name`, the same for all machines and processes."""
    return f".{name[:_MAX_NAME_LENGTH]}."


def write(path: Path, content: bytes, sync: bool = False) -> None:
    """Writes a file atomically; with `sync` it is also flushed to the disk and survives a loss of power.

    Raises:
        UnfinishedError: the disk is full, or the file cannot be written for another reason.
    """
    try:
        replace_file(path, content, sync)
    except OSError as error:
        raise write_error(path, error) from None


def replace_file(path: Path, content: bytes, sync: bool) -> None:
    """Writes a file under its partial name and renames it.

    Raises:
        OSError: the file cannot be written.
    """
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
        _flush_folder(path.parent)


def flush(paths: Collection[Path]) -> None:
    """Flushes files that were written without `sync`, and their names, to the disk.

    Many at a time: the disk is flushed for all that wait, which is twenty times faster than one after the other.

    Raises:
        UnfinishedError: one cannot be flushed, because the disk is full or for another reason.
    """
    with thread_pool(_FLUSHED_AT_ONCE) as pool:
        deque(pool.map(partial(_flushed, _flush_file), paths), maxlen=0)
        deque(pool.map(partial(_flushed, _flush_folder), {path.parent for path in paths}), maxlen=0)


def _flushed(flush: Callable[[Path], None], path: Path) -> None:
    try:
        flush(path)
    except OSError as error:
        raise write_error(path, error) from None


def _flush_file(path: Path) -> None:
    with path.open("rb") as stream:
        os.fsync(stream.fileno())


def _flush_folder(folder: Path) -> None:
    """Flushes renames in the folder to the disk, where the system can."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def remove(path: Path) -> None:
    """Removes a file, if it is there.

    Raises:
        UnfinishedError: it cannot be removed.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise write_error(path, error) from None


def write_error(path: Path, error: OSError) -> UnfinishedError:
    """Error of a campaign that cannot write a file."""
    expected = "room for the results" if error.errno in _DISK_FULL_ERRORS else "a file that can be written"
    reason = (error.strerror or str(error)).lower()
    return UnfinishedError(f"{path}: found {reason}, expected {expected}; finished blocks are kept")


def write_json(path: Path, content: Any) -> None:
    """Writes JSON atomically and flushes it to the disk.

    Raises:
        UnfinishedError: the file cannot be written.
    """
    write(path, json.dumps(content, indent=2, allow_nan=False).encode() + b"\n", sync=True)


def read_json(path: Path, expected: str, kind: FileKind) -> Any:
    """Content of a JSON file of a kind; `expected` describes it in errors.

    Raises:
        ResultError: there is none, or it is no JSON within the limits on size and structure.
    """
    try:
        return json_reading.read_json(path, kind)
    except FileError as error:
        reason = error.found
    except StructureError as error:
        reason = str(error).partition(", expected")[0].removeprefix("found ")
    raise ResultError(f"{path}: found no readable {path.name} ({reason}), expected {expected}")
