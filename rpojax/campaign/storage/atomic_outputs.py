"""Atomic writing of the files that a user asks for, such as reports and records; errors name the file.

Free of NumPy: options of the command line check their files with it.
"""

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rpojax.campaign.storage import atomic_files
from rpojax.errors import OutputError


def check_replaceable(paths: Iterable[Path], force: bool) -> None:
    """Refuses to write over files that exist unless `force` is set.

    Raises:
        OutputError: naming the first file that exists.
    """
    for path in paths:
        if path.exists() and not force:
            raise OutputError(f"{path}: exists already; force=True replaces it")


def write_atomically(path: Path, content: bytes) -> Path:
    """Writes `content` to a temporary file beside `path`, flushes it to disk and renames it; returns `path`.

    Raises:
        OutputError: there cannot be such a file.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_files.replace_file(path, content, sync=True)
    except OSError as error:
        raise OutputError(f"{path}: found {error.strerror or error}, expected a file that can be written") from None
    return path


def write_json(path: Path, content: Any) -> Path:
    """Writes JSON in the same way."""
    return write_atomically(path, json.dumps(content, indent=2, allow_nan=False).encode() + b"\n")


def to_json_types(value: Any) -> Any:
    """`value` in the types of JSON, with None in place of a number that is not finite."""
    if isinstance(value, dict):
        return {str(key): to_json_types(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_json_types(item) for item in value]
    if hasattr(value, "tolist"):  # arrays and numbers of NumPy
        return to_json_types(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, str | int | bool | None) else str(value)
