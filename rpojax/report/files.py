"""Writing files so that a reader never meets half of one."""

import os
from pathlib import Path

from rpojax.campaign.files import partial_name
from rpojax.errors import OutputError


def write_atomically(path: Path, content: bytes) -> Path:
    """Writes `content` to a temporary file beside `path`, flushes it to disk and renames it; returns `path`.

    Raises:
        OutputError: there cannot be such a file.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _write(path, path.with_name(partial_name(path.name)), content)
    except OSError as error:
        raise OutputError(f"{path}: found {error.strerror or error}, expected a file that can be written") from None
    return path


def _write(path: Path, partial: Path, content: bytes) -> None:
    try:
        with partial.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
