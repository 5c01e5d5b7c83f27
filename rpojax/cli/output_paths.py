"""Checks of output paths, made before any work."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from rpojax.campaign.storage.atomic_outputs import check_replaceable
from rpojax.errors import OutputError


def claim(path: Path, force: bool, suffixes: tuple[str, ...] = ()) -> None:
    """Raises `OutputError` if a file cannot be written, or exists and `force` is not set."""
    if suffixes and path.suffix.lower() not in suffixes:
        raise OutputError(f"{path}: found suffix {path.suffix!r}, expected {' or '.join(suffixes)}")
    if path.is_dir():
        raise OutputError(f"{path}: found a folder, expected the name of a file")
    check_replaceable((path,), force)
    home = next(folder for folder in path.absolute().parents if folder.exists())
    if not home.is_dir() or not os.access(home, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: found {home}, expected a folder that can be written to")


def claim_folder(path: Path) -> None:
    """Raises `OutputError` if a folder cannot be created or written to."""
    home = next(folder for folder in (path.absolute(), *path.absolute().parents) if folder.exists())
    if not home.is_dir() or not os.access(home, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: found {home}, expected a folder that can be written to")


@contextlib.contextmanager
def resumable(work: Path) -> Iterator[None]:
    """Adds to an interrupt that the same command continues from `work`."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        raise type(interrupt)(f"the same command goes on from {work}") from None
