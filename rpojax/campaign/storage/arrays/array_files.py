"""Files of `results.zarr`: their names, which histories are there, and which files are lost. Free of jax and zarr.

A lost file is missing or cut short. Files of their full size with other values are not lost but changed.
"""

import math
import operator
import os
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.campaign.storage import atomic_files, safe_paths
from rpojax.campaign.storage.block_manifests import Manifest
from rpojax.errors import ResultError
from rpojax.untrusted.file_reading import FileKind

METADATA = "zarr.json"
_SHARD_ENTRY_BYTES = 16
"""Of a chunk in the index of a shard: offset and length, which are integers of 64 bits."""
_CHECKSUM_BYTES = 4


@dataclass(frozen=True)
class LostFile:
    """A file that does not hold what was written.

    Attributes:
        path: the file
        is_there: whether it is cut short; otherwise it is missing
    """

    path: Path
    is_there: bool

    @property
    def words(self) -> str:
        """What is wrong with it."""
        return "cut short" if self.is_there else "missing"


@dataclass(frozen=True)
class _ArrayFiles:
    """How an array is stored.

    Attributes:
        dimensions: number of axes
        file_bytes: least size of each file, None of a shard
        shard_chunks: number of chunks in the index at the end of a shard
    """

    dimensions: int
    file_bytes: int | None
    shard_chunks: int


def chunk_key(dimensions: int, block: int) -> str:
    """Path, in an array's folder, of the file that holds a block."""
    return "/".join(["c", str(block), *["0"] * (dimensions - 1)])


def stored_history_ids(directory: Path, first_run: int, runs: int) -> list[int]:
    """Numbers of the runs with a complete history: one whose group metadata, written last, exists."""
    folder = directory / "results.zarr" / "histories"
    safe_paths.check_no_links(directory, folder)
    try:
        names = [path.name for path in folder.iterdir() if os.path.lexists(path / METADATA)]
    except OSError:
        return []
    numbers = [int(name) for name in names if name.isdecimal() and name.isascii() and len(name) <= 10]
    return sorted(number for number in numbers if str(number) in names and first_run <= number < first_run + runs)


def lost_of_group(directory: Path, name: str, manifests: Mapping[int, Manifest]) -> dict[int, LostFile]:
    """Block of a manifest -> the first of its files in a group of arrays that is missing or cut short.

    A file may be missing by right: blocks of an older version lack the arrays that it did not know.

    Raises:
        ResultError: a part of the group's path is a symbolic link.
    """
    folder = directory / "results.zarr" / name
    safe_paths.check_no_links(directory, folder)
    blocks = [block for block, entry in manifests.items() if name in entry.sha256]
    found: dict[int, LostFile] = {}
    arrays = _array_folders(folder)
    if blocks and not arrays:
        return dict.fromkeys(blocks, LostFile(folder, is_there=False))
    for path in arrays:
        for block, lost in _of_array(path, blocks):
            found.setdefault(block, lost)
    return found


def lost_of_whole_group(directory: Path, name: str) -> LostFile | None:
    """The first lost file of a group in which each array has one file: a history, or the surface of the target.

    Raises:
        ResultError: a part of the group's path is a symbolic link.
    """
    folder = directory / "results.zarr" / name
    safe_paths.check_no_links(directory, folder)
    for path in _array_folders(folder):
        for _, lost in _of_array(path, [0]):
            return lost
    return None


def _array_folders(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as entries:
            return sorted(Path(entry.path) for entry in entries if _is_array(entry))
    except OSError:
        return []


def _is_array(entry: os.DirEntry[str]) -> bool:
    return entry.is_dir(follow_symlinks=False) and not entry.name.startswith(".")


def _of_array(path: Path, blocks: list[int]) -> Iterator[tuple[int, LostFile]]:
    """Blocks of an array whose file is lost; all of them if the array's metadata are."""
    metadata = path / METADATA
    if not os.path.lexists(metadata) or _size(metadata) == 0:
        yield from ((block, LostFile(metadata, is_there=os.path.lexists(metadata))) for block in blocks)
        return
    if (files := _array_files(metadata)) is None:
        return
    for block in blocks:
        place = path / chunk_key(files.dimensions, block)
        size = _size(place)
        if size is None:
            if not os.path.lexists(place):
                yield block, LostFile(place, is_there=False)
        elif not (_is_whole_shard(place, size, files) if files.file_bytes is None else size >= files.file_bytes):
            yield block, LostFile(place, is_there=True)


def _size(path: Path) -> int | None:
    """Size of a regular file; None for what is none, which reading refuses."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return found.st_size if stat.S_ISREG(found.st_mode) else None


def _array_files(metadata: Path) -> _ArrayFiles | None:
    """How an array is stored by its metadata; None where they are none of this program's, which reading refuses."""
    try:
        content: Any = atomic_files.read_json(metadata, "the metadata of an array", FileKind.ARRAY_METADATA)
        outer = [operator.index(length) for length in content["chunk_grid"]["configuration"]["chunk_shape"]]
        codec = content["codecs"][0]
        dimensions = len(content["shape"])
        if codec["name"] == "sharding_indexed":
            inner = [operator.index(length) for length in codec["configuration"]["chunk_shape"]]
            return _ArrayFiles(dimensions, None, math.prod(-(-a // b) for a, b in zip(outer, inner, strict=True)))
        return _ArrayFiles(dimensions, np.dtype(content["data_type"]).itemsize * math.prod(outer), 0)
    except (ResultError, KeyError, TypeError, IndexError, ValueError, ZeroDivisionError):
        return None


def _is_whole_shard(path: Path, size: int, files: _ArrayFiles) -> bool:
    """Whether the index at the end of a shard names the bytes before it; of one cut short it is elsewhere."""
    length = _SHARD_ENTRY_BYTES * files.shard_chunks
    begin = size - length - _CHECKSUM_BYTES
    if begin < 0:
        return False
    try:
        with path.open("rb") as stream:
            stream.seek(begin)
            index = np.frombuffer(stream.read(length), dtype="<u8").reshape(-1, 2)
    except (OSError, ValueError):
        return True
    written = index[(index != np.iinfo(np.uint64).max).all(axis=1)]
    return int(written.sum(axis=1).max(initial=0)) == begin
